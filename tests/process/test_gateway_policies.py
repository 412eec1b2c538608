"""A trained policy is asked over HTTP: of its agent, and of its file when the agent is gone."""

from __future__ import annotations

import signal
from itertools import pairwise
from pathlib import Path

import numpy as np

from support.gateway_process import gateway
from zengrid.core.observe import prosumer_features
from zengrid.policy.file import Layer, PolicyFile
from zengrid.testing import RunningMarket

QUESTION = {"quantities": {"soc": [0.1, 0.4, 0.7, 0.9], "pv_kw": 2.0, "load_kw": 1.0, "buy_price": 0.07, "hour": 12}}


def trained(path: Path) -> None:
    """A small network with random weights."""
    rng = np.random.default_rng(7)
    features = prosumer_features("public")
    sizes = (len(features), 8, 5)
    layers = tuple(
        Layer(rng.normal(size=(out, inputs)).astype(np.float32), rng.normal(size=out).astype(np.float32))
        for inputs, out in pairwise(sizes)
    )
    PolicyFile(
        role="prosumer",
        observation="public",
        features=features,
        offset=np.zeros(len(features)),
        scale=np.ones(len(features)),
        levels=np.linspace(-1.0, 1.0, 5),
        activation="tanh",
        layers=layers,
        dt_h=1.0,
        name="a test's",
    ).save(path)


def test_an_agent_and_its_file_answer_alike() -> None:
    with RunningMarket("paper", ("--speed", "72000x")) as market:
        shelf = market.folder / "policies"
        shelf.mkdir()
        trained(shelf / "small.safetensors")
        market.start_agents("p2", "p3")
        market.start_prosumer("p1", "--policy", str(shelf / "small.safetensors"))
        market.wait_for_slots(2)
        with gateway(market, "--policies", str(shelf), "--journal", str(market.journal)) as it:
            (file,) = it.get("/v1/policies")["files"]
            assert (file["name"], file["role"]) == ("a test's", "prosumer")
            details = it.get("/v1/policies/p1")
            assert details["levels"] == [-2.0, -1.0, 0.0, 1.0, 2.0]
            by_agent = it.post("/v1/policies/p1/query", QUESTION)
            assert len(by_agent["q_values"]) == 4
            best = np.argmax(by_agent["q_values"], axis=1)
            assert by_agent["actions"] == [by_agent["levels"][i] for i in best]
            market.processes["p1"].signal(signal.SIGKILL)
            market.processes["p2"].signal(signal.SIGKILL)
            by_file = it.post("/v1/policies/p1/query", QUESTION)
            assert by_file["actions"] == by_agent["actions"]
            assert by_file["version"] == by_agent["version"]
            np.testing.assert_allclose(by_file["q_values"], by_agent["q_values"], rtol=1e-6)
            it.wait("/v1/policies", lambda answer: answer.text.count('"away"') == 2, "the word of both deaths")
            gone = it.post("/v1/policies/p2/query", QUESTION, 503)
            assert "it played conventional" in gone["detail"]
            assert it.post("/v1/policies/p1/query", {"observations": [[1, 2]]}, 422)["status"] == 422
