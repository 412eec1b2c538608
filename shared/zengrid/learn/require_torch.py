"""Loads torch, or says how to install it."""

from __future__ import annotations

from zengrid.errors import PolicyError


def require_torch() -> None:
    """Import torch.

    Raises
    ------
    PolicyError
        If the extra ``learn`` is not installed.
    """
    try:
        import torch  # noqa: F401
    except ImportError as error:
        if error.name != "torch":
            raise
        raise PolicyError("torch is not installed; install it with: pip install 'zengrid[learn]'") from None


def load_learning_agents() -> None:
    """Import all that an agent needs to learn: it takes seconds, so do it before a session is opened.

    Raises
    ------
    PolicyError
        If the extra ``learn`` is not installed.
    """
    require_torch()
    import torch
    import torch._dynamo  # optimisers load it at their first step

    import zengrid.learn.live_agents  # noqa: F401

    torch.set_num_threads(1)  # the networks are too small to share out among threads
