"""The current price, from memory."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Depends, Response
from pydantic import BaseModel, Field
from starlette.requests import HTTPConnection

from zengrid_gateway.link import MarketLink
from zengrid_gateway.problems import Problem, documented

router = APIRouter(tags=["market"])


class Price(BaseModel):
    """The prices of the slot settled last."""

    run: str = Field(examples=["main"])
    day: int = Field(examples=[3])
    slot: int = Field(examples=[17])
    time: str = Field(description="Local time at the start of the slot.", examples=["17:00"])
    dt_h: float = Field(description="Length of the slot [h].", examples=[1.0])
    position: int = Field(description="Position of the slot in the journal.", examples=[89])
    buy_price: float = Field(description="What the grid pays for exports [$/kWh].", examples=[0.07])
    sell_price: float = Field(description="What the grid charges for imports [$/kWh].", examples=[0.095])
    state: Literal["waiting", "running", "paused", "ended"] = Field(examples=["running"])


class PriceBoard:
    """Writes the answer once a slot, however often it is asked for."""

    def __init__(self, link: MarketLink) -> None:
        self._link = link
        self._written: tuple[object, str] = (None, "")
        self._body = b""

    def body(self) -> bytes:
        """The current price as JSON.

        Raises
        ------
        Problem
            While the market is away, or before its first slot is settled.
        """
        self._link.check()
        slot, status = self._link.feed.latest, self._link.status
        if slot is None:
            raise Problem("no-slot", f"run {self._link.run}: no slot is settled yet")
        state = slot["state"] if status is None else status.state
        if self._written[0] is not slot or self._written[1] != state:
            fields = {
                name: slot[name] for name in ("run", "day", "slot", "dt_h", "position", "buy_price", "sell_price")
            }
            now = Price(**fields, time=time_of(slot["hour"]), state=state)
            self._written, self._body = (slot, state), now.model_dump_json().encode()
        return self._body


def time_of(hour: float) -> str:
    """13.25 -> 13:15."""
    minutes = round(hour * 60)
    return f"{minutes // 60:02d}:{minutes % 60:02d}"


async def _board(connection: HTTPConnection) -> PriceBoard:
    board: PriceBoard = connection.app.state.board
    return board


@router.get("/v1/price", response_model=Price, responses=documented("market-away", "no-slot"))
async def price(board: Annotated[PriceBoard, Depends(_board)]) -> Response:
    """What the grid pays and charges now: the prices of the slot settled last."""
    return Response(board.body(), media_type="application/json")
