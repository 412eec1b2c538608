"""Pause, go on, step, and change the speed."""

from __future__ import annotations

from typing import Any, Self

from fastapi import APIRouter, Response
from pydantic import BaseModel, ConfigDict, Field, model_validator

from zengrid.wire.codec import JSON, encode
from zengrid.wire.queries import Status
from zengrid_gateway.access import OPERATE
from zengrid_gateway.bodies import BodyRoute
from zengrid_gateway.link import Command, Link
from zengrid_gateway.problems import documented

router = APIRouter(tags=["operation"], route_class=BodyRoute)


EXAMPLES: list[Any] = [
    {"command": "pause"},
    {"command": "resume"},
    {"command": "step", "slots": 24},
    {"command": "speed", "speed": 720},
]


class Control(BaseModel):
    """What the market shall do."""

    model_config = ConfigDict(
        strict=True, extra="forbid", allow_inf_nan=False, json_schema_extra={"examples": EXAMPLES}
    )

    command: Command
    slots: int = Field(default=1, ge=1, le=1_000_000, description="For `step`: slots to run before it stands still.")
    speed: float | None = Field(
        default=None, ge=0, le=1e9, description="For `speed`: times faster than real time, 0 as fast as answers come."
    )

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.command == "speed" and self.speed is None:
            raise ValueError(
                "speed is missing: give 0 to 1e9, times faster than real time; 0 is as fast as answers come"
            )
        return self


@router.post(
    "/v1/control",
    response_model=Status,
    responses=documented("market-away", "forbidden", "refused", "length-required", "too-large", "invalid"),
    dependencies=[OPERATE],
)
async def control(link: Link, request: Control) -> Response:
    """Pause, go on, run some slots, or change the speed; answers how the market stands then."""
    status = await link.control(request.command, slots=request.slots, speed=request.speed)
    return Response(encode(status), media_type=JSON)
