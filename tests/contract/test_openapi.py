"""The gateway does what its OpenAPI document says: no 5xx but a documented 503, and nothing undocumented."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
import schemathesis
from hypothesis import settings
from schemathesis.specs.openapi.checks import positive_data_acceptance

from support.gateway_process import Gateway, running
from zengrid_gateway.access import Access
from zengrid_gateway.app import create_app
from zengrid_gateway.settings import Settings
from zengrid_gateway.tokens import Tokens

EXAMPLES = 5
"""Questions to each route; the slow test asks more."""

# Besides the codes that Schemathesis takes for a refusal: no length, too large, not this server.
REFUSALS = [
    "400",
    "401",
    "403",
    "404",
    "405",
    "406",
    "409",
    "411",
    "413",
    "414",
    "415",
    "421",
    "422",
    "428",
    "429",
    "431",
    "5xx",
]
CONFIG = schemathesis.Config.from_dict(
    {"request-timeout": 60, "checks": {"negative_data_rejection": {"expected-statuses": REFUSALS}}}
)

document = create_app(Settings(), Access("nothing", Tokens({}))).openapi()
# A live stream never ends; it has tests of its own.
schema = schemathesis.openapi.from_dict(document, config=CONFIG).exclude(path="/v1/live")


@pytest.fixture(scope="module")
def gateway() -> Iterator[Gateway]:
    with running("--speed", "72000x", spawner=("--limit", "1")) as it:
        yield it


@schema.parametrize()
@settings(max_examples=EXAMPLES)
def test_answers_follow_the_document(case: Any, gateway: Gateway) -> None:
    # What fits the schema may still make no sense to the market: that has tests of its own.
    case.call_and_validate(base_url=gateway.url, excluded_checks=[positive_data_acceptance])


@pytest.mark.slow
@schema.parametrize()
@settings(max_examples=10 * EXAMPLES)
def test_answers_follow_the_document_for_many_more_requests(case: Any, gateway: Gateway) -> None:
    # What fits the schema may still make no sense to the market: that has tests of its own.
    case.call_and_validate(base_url=gateway.url, excluded_checks=[positive_data_acceptance])
