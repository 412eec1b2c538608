"""What holds for all tests: how hard hypothesis tries."""

from __future__ import annotations

import os

from hypothesis import HealthCheck, settings

# A shared runner is sometimes slow, which says nothing about the code; and it must find today what it found yesterday.
settings.register_profile("local", max_examples=50, deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("ci", parent=settings.get_profile("local"), max_examples=200, derandomize=True, database=None)
settings.load_profile("ci" if os.environ.get("CI") else "local")
