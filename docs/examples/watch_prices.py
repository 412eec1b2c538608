"""Print both prices of every settled slot; reconnect when the market returns."""

import json
import sys
import time
from collections.abc import Iterator
from itertools import islice

import httpx


def slots(url: str) -> Iterator[dict[str, object]]:
    """Yield every settled slot from now on, including those while the gateway was away."""
    seen: dict[str, str] = {}
    while True:
        try:
            with httpx.stream("GET", f"{url}/v1/live", headers=seen, timeout=httpx.Timeout(5.0, read=60.0)) as response:
                response.raise_for_status()
                for line in response.iter_lines():
                    if line.startswith("id: "):
                        seen = {"last-event-id": line[4:]}
                    elif line.startswith('data: {"v"'):
                        yield json.loads(line[6:])
        except httpx.HTTPError as error:
            print(f"{error}; trying again", file=sys.stderr)
            time.sleep(1.0)


if __name__ == "__main__":
    for slot in islice(slots(sys.argv[1]), int(sys.argv[2])):
        print(f"day {slot['day']} slot {slot['slot']}: pays {slot['buy_price']}, charges {slot['sell_price']} $/kWh")
