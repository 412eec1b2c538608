"""Policy files that the gateway may read: it answers by them where the agent that plays one is gone."""

from __future__ import annotations

import asyncio
from pathlib import Path, PurePath
from typing import Annotated

import numpy as np
from fastapi import Depends
from starlette.requests import HTTPConnection

from zengrid.core.levels import to_commands
from zengrid.policy.file import PolicyFile
from zengrid.policy.network import Network, greedy
from zengrid.scenario import HomeSpec, homes_params
from zengrid.wire.queries import PolicyReply
from zengrid_gateway.archive import Archive, JournalPast
from zengrid_gateway.link import MarketLink
from zengrid_gateway.problems import Problem
from zengrid_gateway.scenario import read

SUFFIX = ".safetensors"


class Shelf:
    """The files of one folder; None for a gateway that was given no folder."""

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder

    def files(self) -> list[PolicyFile]:
        """All of them, by name. Blocks the calling thread."""
        paths = [] if self._folder is None else sorted(self._folder.glob(f"*{SUFFIX}"))
        return [PolicyFile.load(path) for path in paths]

    def find(self, policy: str) -> PolicyFile | None:
        """The file that an agent plays; only its name counts, and only names in the folder."""
        name = PurePath(policy).name
        if self._folder is None or name not in {path.name for path in self._folder.glob(f"*{SUFFIX}")}:
            return None
        return PolicyFile.load(self._folder / name)


def answer(file: PolicyFile, agent: str, home: HomeSpec | None, rows: tuple[tuple[float, ...], ...]) -> PolicyReply:
    """What the policy in a file would do, row by row, as its agent would answer.

    Parameters
    ----------
    home:
        Whose battery is commanded; None for the grid.
    """
    for i, row in enumerate(rows):
        if len(row) != len(file.features):
            wanted = ", ".join(file.features)
            raise Problem("invalid", f"observations.{i} has {len(row)} numbers: give {len(file.features)}: {wanted}")
    observations = np.array(rows)
    if home is None:
        levels, values = file.levels, Network(file).q_values(observations)
    else:
        levels = to_commands(file.levels[:, None], homes_params([home]))[:, 0]
        network = Network(file, (home.id,) if file.homes else ())
        values = network.q_values(observations[:, None, :])[:, 0]
    return PolicyReply(
        agent=agent,
        policy=file.name,
        version=file.version,
        features=file.features,
        levels=tuple(levels.tolist()),
        actions=tuple(levels[greedy(values)].tolist()),
        q_values=tuple(tuple(row) for row in values.tolist()),
    )


async def home_spec(link: MarketLink, archive: Archive, home: str) -> HomeSpec:
    """A home as it was described when it joined, or by the scenario."""
    past = await archive.current()
    if isinstance(past, JournalPast):
        roster = await asyncio.to_thread(past.run.roster)
        found = [spec for name, spec in zip(roster.homes, roster.specs, strict=True) if name == home]
    else:
        fields = await asyncio.to_thread(read, await link.ask(lambda client: client.scenario()))
        found = [spec for spec in fields.get("homes", ()) if spec["id"] == home]
    if not found:
        raise Problem(
            "agent-away", f"home = {home}: its agent is gone, and its battery is known to no journal or scenario"
        )
    return HomeSpec.model_validate(found[0])


async def _shelf(connection: HTTPConnection) -> Shelf:
    shelf: Shelf = connection.app.state.shelf
    return shelf


ShelfOf = Annotated[Shelf, Depends(_shelf)]
"""The files, for routes."""
