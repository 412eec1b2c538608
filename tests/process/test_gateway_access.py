"""A gateway that others can reach: tokens, rates, other sites."""

from __future__ import annotations

import stat
from collections.abc import Iterator

import pytest

from support.gateway_process import Gateway, gateway, running

PAUSE = {"command": "pause"}


@pytest.fixture(scope="module")
def open_one() -> Iterator[Gateway]:
    with running("--speed", "3600x") as it:
        yield it


@pytest.fixture(scope="module")
def guarded(open_one: Gateway) -> Iterator[Gateway]:
    tokens = open_one.market.folder / "state" / "tokens.json"
    with gateway(open_one.market, "--protect", "everything", "--tokens", str(tokens)) as it:
        yield it


def tokens(guarded: Gateway) -> dict[str, str]:
    """What it has shown when it was started for the first time."""
    shown = [
        line.rpartition(": ")[2] for line in guarded.process.output().splitlines() if "shown this one time" in line
    ]
    return {token.split("_")[1]: token for token in shown}


def bearer(token: str) -> dict[str, str]:
    return {"authorization": f"Bearer {token}"}


def test_each_token_permits_only_its_role(guarded: Gateway) -> None:
    made = tokens(guarded)
    assert set(made) == {"read", "operate"}
    refused = guarded.http.get("/v1/price")
    assert refused.status_code == 401
    assert refused.headers["www-authenticate"].startswith("Bearer")
    assert guarded.get("/v1/market", 401)["type"] == "urn:zengrid:unauthorized"
    assert guarded.get("/v1/price", 401, headers=bearer("zengrid_read_guessed"))["status"] == 401
    assert guarded.get("/v1/price", headers=bearer(made["read"]))["run"] == "test"
    assert guarded.post("/v1/control", PAUSE, 401)["status"] == 401
    assert "operate" in guarded.post("/v1/control", PAUSE, 403, headers=bearer(made["read"]))["detail"]
    assert guarded.post("/v1/control", PAUSE, headers=bearer(made["operate"]))["state"] == "paused"
    assert guarded.post("/v1/control", {"command": "resume"}, headers=bearer(made["operate"]))["state"] == "running"
    # The page itself and the health of the gateway tell nothing of the market.
    assert guarded.http.get("/").status_code == 200
    assert guarded.get("/healthz") == {"status": "ok"}


def test_tokens_are_kept_as_hashes_and_shown_once(guarded: Gateway) -> None:
    market = guarded.market
    path = market.folder / "state" / "tokens.json"
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    made = tokens(guarded)
    assert not any(token in path.read_text() for token in made.values())
    with gateway(market, "--protect", "everything", "--tokens", str(path)) as again:
        assert tokens(again) == {}
        assert again.get("/v1/market", headers=bearer(made["read"]))["run"] == "test"


def test_writing_alone_can_be_protected(open_one: Gateway) -> None:
    path = open_one.market.folder / "other" / "tokens.json"
    with gateway(open_one.market, "--protect", "writing", "--tokens", str(path)) as it:
        assert it.get("/v1/market")["run"] == "test"
        assert it.post("/v1/control", PAUSE, 401)["status"] == 401
        assert it.http.delete("/v1/prosumers/p1").status_code == 401


def test_requests_beyond_the_rate_are_refused_with_429(open_one: Gateway) -> None:
    with gateway(open_one.market, "--rate", "2") as it:
        answers = [it.http.get("/healthz") for _ in range(30)]
        assert {answer.status_code for answer in answers} == {200, 429}
        late = next(answer for answer in answers if answer.status_code == 429)
        assert late.headers["retry-after"] == "1"
        assert late.json()["type"] == "urn:zengrid:too-many"


def test_an_allowed_site_may_use_the_gateway(open_one: Gateway) -> None:
    friend, stranger = "https://friend.example", "https://stranger.example"
    with gateway(open_one.market, "--cors", friend) as it:
        assert it.http.get("/v1/price", headers={"origin": friend}).headers["access-control-allow-origin"] == friend
        assert "access-control-allow-origin" not in it.http.get("/v1/price", headers={"origin": stranger}).headers
        assert it.post("/v1/control", PAUSE, headers={"origin": friend})["state"] == "paused"
        assert it.post("/v1/control", PAUSE, 403, headers={"origin": stranger})["status"] == 403
        assert it.post("/v1/control", {"command": "resume"})["state"] == "running"


def test_an_address_in_use_is_reported(open_one: Gateway) -> None:
    second = Gateway(open_one.market, "--port", str(open_one.port))
    with second.http:
        assert second.process.end() == 1
        assert "cannot listen there" in second.process.output()
