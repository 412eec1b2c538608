"""Whether the gateway lives, and whether it has a market to show."""

from __future__ import annotations

from typing import Literal

from fastapi import APIRouter
from pydantic import BaseModel

from zengrid_gateway.link import Link
from zengrid_gateway.problems import documented

router = APIRouter(tags=["operation"])


class Health(BaseModel):
    """The gateway can answer."""

    status: Literal["ok"] = "ok"


@router.get("/healthz", responses=documented())
async def healthz() -> Health:
    """Whether the gateway lives; does not look at the market."""
    return Health()


@router.get("/readyz", responses=documented("market-away"))
async def readyz(link: Link) -> Health:
    """Whether the gateway has a market to show."""
    link.check()
    return Health()
