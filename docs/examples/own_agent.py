"""A prosumer agent with nothing but Zenoh and JSON: stores its own surplus, sells while the grid pays well.

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
given = options.parse_args()

root = f"zengrid/@v1/{given.run}"
me = {"agent": given.id, "instance": secrets.token_hex(8)}
wish = {**me, "role": "prosumer", "policy": "own_agent"}
if given.battery is not None:
    wish["homes"] = [{"id": given.id, "pv_kw": given.pv or 0, "battery": {"capacity_kwh": given.battery}}]

config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([given.connect]))

with zenoh.open(config) as session:
    # 1. Subscribe first, join second, show the liveliness token last: from then on the market waits for us.
    observations = session.declare_subscriber(f"{root}/agent/{given.id}/observation", zenoh.handlers.FifoChannel(64))
    reply = next(iter(session.get(f"{root}/clock/join", payload=json.dumps(wish))), None)
    if reply is None or reply.ok is None:
        raise SystemExit("refused: " + (reply.err.payload.to_string() if reply else "nobody answered"))
    homes = json.loads(reply.ok.payload.to_string())["homes"]
    token = session.liveliness().declare_token(f"{root}/agent/{given.id}/alive")

    # 2. Answer every observation with one command for each home: > 0 charges the battery, < 0 discharges it [kW].
    try:
        for sample in observations:
            seen = json.loads(sample.payload.to_string())
            if seen["phase"] == "end":
                break
            commands = []
            for home, pv_kw, load_kw in zip(homes, seen["pv_kw"], seen["load_kw"], strict=True):
                wanted = -home["discharge_max_kw"] if seen["buy_price"] > 0.07 else pv_kw - load_kw
                commands.append(min(max(wanted, -home["discharge_max_kw"]), home["charge_max_kw"]))
            action = {key: seen[key] for key in ("run", "day", "slot", "phase")}
            action |= {"instance": me["instance"], "battery_kw": commands}
            session.put(
                f"{root}/agent/{given.id}/action",
                json.dumps(action),
                congestion_control=zenoh.CongestionControl.BLOCK,
            )
    except KeyboardInterrupt:
        if "homes" in wish:  # what came with us leaves with us
            list(session.get(f"{root}/clock/leave", payload=json.dumps(me)))
