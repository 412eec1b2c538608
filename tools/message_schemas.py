"""JSON Schema files and an AsyncAPI document, generated from the messages.

``make schemas`` writes them into ``docs/protocol``; a test checks that they are up to date.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any, NamedTuple

from zengrid.wire import queries, slots, spawner_queries
from zengrid.wire.base import Message
from zengrid.wire.codec import JSON


class Channel(NamedTuple):
    """One key of the protocol."""

    name: str
    address: str
    says: str
    messages: tuple[type[Message], ...]
    replies: tuple[type[Message], ...] = ()


CHANNELS = (
    Channel(
        "slot",
        "clock/slot",
        "The clock publishes each settled slot; a plain get answers with the latest.",
        (slots.PublicSlot,),
    ),
    Channel(
        "observation",
        "agent/{id}/observation",
        "The clock tells an agent what it may see, once a slot.",
        (slots.GridObservation, slots.FleetObservation),
    ),
    Channel("action", "agent/{id}/action", "An agent answers its observation.", (slots.GridAction, slots.FleetAction)),
    Channel(
        "policy",
        "agent/{id}/policy",
        "Anyone asks an agent what it would do.",
        (queries.PolicyRequest,),
        (queries.PolicyReply,),
    ),
    Channel(
        "join",
        "clock/join/{id}",
        "A process asks to play an agent, with or without new homes.",
        (queries.JoinRequest,),
        (queries.JoinReply,),
    ),
    Channel(
        "leave",
        "clock/leave/{id}",
        "A process takes its homes out.",
        (queries.LeaveRequest,),
        (queries.LeaveReply,),
    ),
    Channel("control", "clock/control", "Operators steer the market.", (queries.ControlRequest,), (queries.Status,)),
    Channel(
        "history",
        "clock/history",
        "Operators read settled slots.",
        (queries.HistoryRequest,),
        (queries.HistoryReply,),
    ),
    Channel(
        "scenario",
        "clock/scenario",
        "Operators read what the market plays.",
        (queries.ScenarioRequest,),
        (queries.ScenarioReply,),
    ),
    Channel(
        "spawn",
        "spawner/{id}/spawn",
        "The gateway has a prosumer process started.",
        (spawner_queries.SpawnRequest,),
        (spawner_queries.ProcessStatus,),
    ),
    Channel("stop", "spawner/{id}/stop", "And ended.", (spawner_queries.StopRequest,), (spawner_queries.StopReply,)),
    Channel(
        "spawner",
        "spawner/{id}/status",
        "A spawner tells how it stands; asked with `*` for an id, all do.",
        (spawner_queries.SpawnerRequest,),
        (spawner_queries.SpawnerStatus,),
    ),
)
"""Every channel with its messages. Queries may be refused with a `Refusal` as Zenoh error reply."""

MESSAGES: tuple[type[Message], ...] = (
    *(kind for channel in CHANNELS for kind in (*channel.messages, *channel.replies)),
    queries.Refusal,
)


def json_schema(kind: type[Message]) -> dict[str, Any]:
    """JSON Schema (2020-12) of one message."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **kind.model_json_schema(mode="validation")}


def asyncapi() -> dict[str, Any]:
    """AsyncAPI 3.0 document of the whole protocol."""
    channels: dict[str, Any] = {}
    operations: dict[str, Any] = {}
    for channel in CHANNELS:
        names = [kind.__name__ for kind in channel.messages]
        channels[channel.name] = {
            "address": f"zengrid/@v1/{{run}}/{channel.address}",
            "description": channel.says,
            "parameters": {
                name: {"description": f"Name of the {what}."}
                for name, what in (
                    ("run", "run"),
                    ("id", "spawner" if channel.address.startswith("spawner") else "agent"),
                )
                if name == "run" or "{id}" in channel.address
            },
            "messages": {
                name: {"$ref": f"#/components/messages/{name}"}
                for name in names + [r.__name__ for r in channel.replies]
            },
        }
        operation: dict[str, Any] = {
            "action": "send" if channel.name in ("slot", "observation") else "receive",
            "channel": {"$ref": f"#/channels/{channel.name}"},
            "summary": channel.says,
            "messages": [{"$ref": f"#/channels/{channel.name}/messages/{name}"} for name in names],
        }
        if channel.replies:
            operation["reply"] = {
                "channel": {"$ref": f"#/channels/{channel.name}"},
                "messages": [{"$ref": f"#/channels/{channel.name}/messages/{r.__name__}"} for r in channel.replies],
            }
        operations[channel.name] = operation
    return {
        "asyncapi": "3.0.0",
        "info": {
            "title": "zengrid",
            "version": "1",
            "description": "The market's messages over Zenoh, as the clock sends and receives them. "
            "Queries are Zenoh get calls; a refusal comes as an error reply with a Refusal message.",
        },
        "defaultContentType": JSON,
        "channels": channels,
        "operations": operations,
        "components": {
            "messages": {
                kind.__name__: {
                    "name": kind.__name__,
                    "summary": (kind.__doc__ or "").split("\n")[0],
                    "payload": {"$ref": f"schemas/{kind.__name__}.json"},
                }
                for kind in MESSAGES
            }
        },
    }


def documents() -> dict[str, str]:
    """Every generated file: its name and its text."""
    files = {f"schemas/{kind.__name__}.json": json_schema(kind) for kind in MESSAGES}
    return {name: json.dumps(body, indent=2) + "\n" for name, body in {**files, "asyncapi.json": asyncapi()}.items()}


def main(folder: Path) -> None:
    """Write all files."""
    for name, text in documents().items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
