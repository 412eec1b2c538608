"""A prosumer agent that needs only Zenoh and JSON. It stores its surplus and sells while the grid pays well.

python own_agent.py p1        # plays home p1 of the running market
python own_agent.py p9 5 10   # adds a home of its own, with 5 kW of PV and a battery of 10 kWh
"""

import json
import os
import secrets
import sys

import zenoh

name, *brought = sys.argv[1:]
me = {"agent": name, "instance": secrets.token_hex(8)}
request = {**me, "role": "prosumer", "policy": "own_agent"}
if brought:
    pv_kw, capacity_kwh = map(float, brought)
    request["homes"] = [{"id": name, "pv_kw": pv_kw, "battery": {"capacity_kwh": capacity_kwh}}]

root = "zengrid/@v1/" + os.environ.get("ZENGRID_RUN", "main")
config = zenoh.Config.from_json5('{mode: "client", connect: {timeout_ms: 30000}}')
config.insert_json5("connect/endpoints", json.dumps([os.environ.get("ZENGRID_CONNECT", "tcp/127.0.0.1:7447")]))

with zenoh.open(config) as session:
    # Subscribe first, join second, declare the liveliness token last: then the market waits for this agent.
    observations = session.declare_subscriber(f"{root}/agent/{name}/observation", zenoh.handlers.FifoChannel(64))
    reply = next(iter(session.get(f"{root}/clock/join/{name}", payload=json.dumps(request))), None)
    if reply is None or reply.ok is None:
        raise SystemExit("refused: " + (reply.err.payload.to_string() if reply else "no clock answered"))
    homes = json.loads(reply.ok.payload.to_string())["homes"]
    token = session.liveliness().declare_token(f"{root}/agent/{name}/alive")
    publisher = session.declare_publisher(
        f"{root}/agent/{name}/action", congestion_control=zenoh.CongestionControl.BLOCK
    )
    try:
        for sample in observations:
            seen = json.loads(sample.payload.to_string())
            if seen["phase"] == "end":
                break
            # One command for each home: > 0 charges the battery, < 0 discharges it [kW].
            commands = []
            for home, pv_kw, load_kw in zip(homes, seen["pv_kw"], seen["load_kw"], strict=True):
                wanted = -home["discharge_max_kw"] if seen["buy_price"] > 0.07 else pv_kw - load_kw
                commands.append(min(max(wanted, -home["discharge_max_kw"]), home["charge_max_kw"]))
            slot = {key: seen[key] for key in ("run", "day", "slot", "phase")}
            publisher.put(json.dumps({**slot, "instance": me["instance"], "battery_kw": commands}))
    except KeyboardInterrupt:
        if brought:  # take the home out that this agent brought
            list(session.get(f"{root}/clock/leave/{name}", payload=json.dumps(me)))
