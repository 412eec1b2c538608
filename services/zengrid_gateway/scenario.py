"""The scenario that a market plays."""

from __future__ import annotations

import asyncio
from functools import lru_cache
from pathlib import PurePath
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Response
from pydantic_core import to_json

from zengrid.scenario.files import parse, write
from zengrid_gateway.archive import ArchiveOf, JournalPast
from zengrid_gateway.link import Link
from zengrid_gateway.problems import documented

router = APIRouter(tags=["market"])

EXAMPLE = {
    "name": "paper",
    "title": "The case study of the paper, 3 prosumers and 1 consumer",
    "slot_minutes": 60,
    "tariff": [{"from": "00:00", "price": 0.05}, {"from": "11:00", "price": 0.095}],
    "buy_prices": [0.05, 0.06, 0.07, 0.08, 0.09, 0.1],
    "facilities": [{"name": "base", "min_kw": 5, "max_kw": 20, "b": 0.03}],
    "homes": [{"id": "p1", "pv_kw": 4, "battery": {"capacity_kwh": 6, "initial_kwh": 3}}],
}


@router.get(
    "/v1/scenario",
    response_model=dict[str, Any],
    responses={
        200: {
            "content": {
                "application/json": {"example": EXAMPLE},
                "application/yaml": {"schema": {}, "example": EXAMPLE},
            }
        },
        **documented("market-away", "journal-away", "not-found", "invalid"),
    },
)
async def scenario(
    link: Link,
    archive: ArchiveOf,
    format: Annotated[Literal["json", "yaml"], Query(description="YAML is what `zengrid up FILE` reads.")] = "json",
    run: Annotated[str | None, Query(max_length=80, description="A run of /v1/runs; default the current one.")] = None,
) -> Response:
    """What is played: tariff, price levels, facilities, homes, data, noise, seed."""
    if run is None and link.feed.present:
        text = await link.ask(lambda client: client.scenario())
    else:
        past = await archive.past(run)
        assert isinstance(past, JournalPast)
        text = await asyncio.to_thread(past.run.scenario)
    return Response(await asyncio.to_thread(_write, text, format), media_type=f"application/{format}")


@lru_cache(maxsize=4)
def _write(text: str, format: Literal["json", "yaml"]) -> bytes:
    """Encode a scenario. Takes seconds for thousands of homes, and the scenario of a run never changes."""
    fields = read(text)
    if format == "json":
        return to_json(fields)
    return write(fields).encode()


@lru_cache(maxsize=2)
def read(text: str) -> dict[str, Any]:
    """The fields, without the folders that data lies in: they are this machine's own business."""
    fields = parse(text)
    data = fields.get("data")
    if isinstance(data, dict):
        for name in ("path", "file"):
            if isinstance(data.get(name), str):
                data[name] = PurePath(data[name]).name
    return fields
