"""A prosumer that answers some observations and then hangs for ever, while its process lives."""

from __future__ import annotations

import re
import secrets
import sys

import numpy as np

from zengrid.bus.agent_link import AgentLink
from zengrid.wire.codec import JSON, decode, encode
from zengrid.wire.queries import JoinRequest
from zengrid.wire.slots import FleetAction, FleetObservation


def main(agent: str, endpoint: str, run: str, answers: int) -> None:
    """Join, answer so many times, hang."""
    instance = secrets.token_hex(8)
    with AgentLink(agent, run, endpoint) as link:
        link.join(JoinRequest(agent=agent, role="prosumer", instance=instance))
        link.ready()
        for _ in range(answers):
            arrival = link.receive()
            assert arrival is not None
            seen = decode(FleetObservation, arrival.payload)
            action = FleetAction(
                run=run, day=seen.day, slot=seen.slot, instance=instance, battery_kw=np.zeros(len(seen.soc))
            )
            link.act(encode(action), JSON)
        # Catastrophic backtracking never gives up the interpreter's lock: no signal handler, no other thread runs.
        re.match(r"(a+)+$", "a" * 64 + "b")


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], sys.argv[3], int(sys.argv[4]))
