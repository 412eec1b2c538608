"""Networks in tests are so small that threads would only wait for each other."""

from __future__ import annotations

import pytest


@pytest.fixture(autouse=True, scope="session")
def one_thread() -> None:
    torch = pytest.importorskip("torch", reason="extra learn is not installed")
    torch.set_num_threads(1)
