"""How the market stands."""

from __future__ import annotations

from fastapi import APIRouter, Response

from zengrid.wire.codec import JSON, encode
from zengrid.wire.queries import Status
from zengrid_gateway.link import Link
from zengrid_gateway.problems import documented

router = APIRouter(tags=["market"])


@router.get("/v1/market", response_model=Status, responses=documented("market-away"))
async def market(link: Link) -> Response:
    """The market now: state, prices, energy, money beside no demand response, agents. At most a second old."""
    return Response(encode(await link.known_status()), media_type=JSON)
