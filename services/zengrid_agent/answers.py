"""Answers what a policy would do, for anyone who asks."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from zengrid.errors import PolicyError
from zengrid.policy.facts import MarketFacts
from zengrid.policy.views import GridPolicy, ProsumerPolicy
from zengrid.wire.queries import PolicyReply, PolicyRequest


def policy_reply(
    agent: str,
    policy: ProsumerPolicy | GridPolicy,
    features: Sequence[str],
    request: PolicyRequest,
    act: Callable[[dict[str, float]], float],
) -> PolicyReply:
    """Actions row by row, and Q-values where the policy has them."""
    features = getattr(policy, "features", features)
    for i, row in enumerate(request.observations):
        if len(row) != len(features):
            raise PolicyError(f"observations.{i} has {len(row)} numbers: give {len(features)}: {', '.join(features)}")
    levels: tuple[float, ...] = ()
    q_values = None
    network: Any = policy if hasattr(policy, "q_values") else None
    if network is not None:
        values = network.q_values(np.array(request.observations))
        levels = tuple(float(level) for level in network.levels)
        actions = tuple(levels[i] for i in values.argmax(axis=-1))
        q_values = tuple(tuple(row) for row in values.tolist())
    else:
        actions = tuple(act(dict(zip(features, row, strict=True))) for row in request.observations)
    return PolicyReply(
        agent=agent,
        policy=policy.name,
        version=policy.version,
        features=tuple(features),
        levels=levels,
        actions=actions,
        q_values=q_values,
    )


def slot_of(row: dict[str, float], facts: MarketFacts) -> int:
    """The slot of the day that an observation's sine and cosine of the time mean."""
    hour = (math.atan2(row["time_sin"], row["time_cos"]) / (2 * math.pi)) % 1.0 * 24.0
    return round(hour / facts.dt_h) % facts.slots_per_day
