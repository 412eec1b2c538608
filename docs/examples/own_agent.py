"""A prosumer agent of your own, with nothing but Zenoh and JSON: sells in the evening, stores at noon.

python own_agent.py p1                      # plays home p1 of the running market
python own_agent.py p9 --pv 5 --battery 10  # brings a home of its own
"""

import argparse
import json
import secrets

import zenoh

options = argparse.ArgumentParser()
options.add_argument("id")
options.add_argument("--pv", type=float)
options.add_argument("--battery", type=float)
options.add_argument("--connect", default="tcp/127.0.0.1:7447")
options.add_argument("--run", default="main")
chosen = options.parse_args()

root = f"zengrid/@v1/{chosen.run}"
me = {"agent": chosen.id, "role": "prosumer", "instance": secrets.token_hex(8), "policy": "own_agent"}
if chosen.battery is not None:
    me["homes"] = [{"id": chosen.id, "pv_kw": chosen.pv or 0.0, "battery": {"capacity_kwh": chosen.battery}}]

config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([chosen.connect]))

with zenoh.open(config) as session:
    # 1. Subscribe first, join second, show the liveliness token last: from then on the market waits for us.
    observations = session.declare_subscriber(f"{root}/agent/{chosen.id}/observation", zenoh.handlers.FifoChannel(64))
    reply = next(iter(session.get(f"{root}/clock/join", payload=json.dumps(me))), None)
    if reply is None or reply.ok is None:
        raise SystemExit("refused: " + (reply.err.payload.to_string() if reply else "nobody answered"))
    homes = json.loads(reply.ok.payload.to_string())["homes"]
    token = session.liveliness().declare_token(f"{root}/agent/{chosen.id}/alive")

    # 2. Answer every observation with one command per home: > 0 charges the battery, < 0 discharges it [kW].
    for sample in observations:
        seen = json.loads(sample.payload.to_string())
        if seen["phase"] == "end":
            break
        battery_kw = [-h["discharge_max_kw"] if seen["buy_price"] > 0.06 else h["charge_max_kw"] for h in homes]
        action = {key: seen[key] for key in ("run", "day", "slot", "phase")}
        action |= {"instance": me["instance"], "battery_kw": battery_kw}
        session.put(f"{root}/agent/{chosen.id}/action", json.dumps(action))
