"""A training repeats exactly, resumes exactly, and leaves policies that play as it played."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="extra learn is not installed")

import torch

from zengrid.env.facts import market_facts
from zengrid.errors import PolicyError
from zengrid.learn import checkpoint
from zengrid.learn.evaluation import Changes, Evaluation, Evaluator, Gap, Outcome, Rank, Trained, reaches
from zengrid.learn.run import PROGRESS, Plan, Report, Run
from zengrid.learn.settings import Settings
from zengrid.learn.training import Progress, Training
from zengrid.policy.file import PolicyFile
from zengrid.policy.network import GridNetwork, ProsumerNetwork
from zengrid.policy.tensor_file import TensorFile
from zengrid.scenario import load

PAPER = load("paper")
TINY = Settings.preset("fast").with_(days=4, pool=16, steps=240, memory=400, hidden=(32, 16), batch=8)


def training(seeds: tuple[int, ...] = (0, 1), settings: Settings = TINY, **changes: object) -> Training:
    scenario = PAPER.with_(**changes) if changes else PAPER
    return Training([scenario] * len(seeds), seeds, settings)


def same(one: list[Trained], other: list[Trained]) -> bool:
    return [(a.grid.version, a.prosumers.version) for a in one] == [
        (b.grid.version, b.prosumers.version) for b in other
    ]


@pytest.mark.parametrize("soc_reset", ["daily", "never"])
def test_a_seed_repeats_and_a_checkpoint_goes_on_exactly(soc_reset: str, tmp_path: Path) -> None:
    straight = training(soc_reset=soc_reset)
    for _ in range(10):
        straight.day()
    stopped = training(soc_reset=soc_reset)
    for _ in range(4):
        stopped.day()
    checkpoint.save(tmp_path / "state", "test", stopped.state())
    again = training(soc_reset=soc_reset)
    with TensorFile(tmp_path / "state") as file:
        tensors = {name: torch.from_numpy(array) for name, array in file.read().items()}
        again.restore(checkpoint.State(checkpoint.read_values(file, "test", Progress), tensors))
    while not again.done:
        again.day()
    assert same(straight.trained(), again.trained())
    assert same(straight.trained("online"), again.trained("online"))
    assert not same(straight.trained(), stopped.trained())


def test_other_seeds_learn_other_policies() -> None:
    one = training((3, 4))
    for _ in range(2):
        one.day()
    first, second = one.trained()
    assert first.grid.version != second.grid.version
    assert first.prosumers.version != second.prosumers.version


@pytest.mark.parametrize("observation", ["public", "paper"])
def test_the_files_play_what_the_networks_play(observation: str, tmp_path: Path) -> None:
    learner = Training([PAPER] * 2, (0, 1), TINY, observation)  # type: ignore[arg-type]
    for _ in range(3):
        learner.day()
    learner.vector.begin(learner.vector._profile, PAPER.market().homes.soc_initial)
    files = learner.trained("online")
    view = learner.vector.grid_view()
    seen = learner._tensor(learner.scales.grid(learner.vector.grid_observation(learner.observation)))
    levels = learner.grid.act(seen, 0.0).numpy()
    for market, trained in enumerate(files):
        trained.grid.save(tmp_path / "grid.safetensors")
        policy = GridNetwork(PolicyFile.load(tmp_path / "grid.safetensors"), market_facts(PAPER))
        price = np.asarray(policy.act(view))[market]
        assert (price == learner.buy_prices[levels[market]]).all()
    price = learner.buy_prices[levels]
    seen = learner._by_home(learner.scales.prosumer(learner.vector.prosumer_observation(learner.observation, price)))
    chosen = learner.prosumers.act(seen, 0.0).numpy().reshape(2, 3, -1)
    for market, trained in enumerate(files):
        prosumers = ProsumerNetwork(trained.prosumers, market_facts(PAPER, PAPER.home_ids))
        commands = prosumers.act(learner.vector.prosumer_view(price))[market]
        expected = np.take_along_axis(learner._commands_kw[market], chosen[market], axis=-1).T
        assert (commands == expected).mean() > 0.99  # float32 and float64 may see a tie differently


def test_variants_are_trained_side_by_side() -> None:
    sizes = [2.0, 12.0]
    scenarios = [
        PAPER.with_(**{"homes.*.battery.capacity_kwh": size, "homes.*.battery.initial_kwh": None}) for size in sizes
    ]
    learner = Training(scenarios, (0, 0), TINY)
    learner.day()
    assert learner.vector.soc.shape == (2, 4, 3)
    assert learner.prosumers.model is not None
    assert learner.prosumers.model.capacity_kwh.flatten().tolist() == [2.0] * 3 + [12.0] * 3
    with pytest.raises(PolicyError, match="soc_reset: markets trained side by side"):
        Training([PAPER, PAPER.with_(soc_reset="never")], (0, 0), TINY)


def test_a_run_keeps_the_best_and_resumes(tmp_path: Path) -> None:
    plan = Plan((PAPER,) * 2, (0, 1), TINY, "public", "zengrid train paper")
    reports: list[Report] = []
    run = Run(tmp_path / "a", plan)
    assert not run.go(reports.append, stop=lambda: run.training.step >= 96, every=2)
    assert run.training.step == 96
    resumed = Run.resume(tmp_path / "a")
    assert resumed.best[0] is not None
    assert resumed.go(reports.append, every=2)
    straight = Run(tmp_path / "b", plan)
    assert straight.go(reports.append, every=2)
    assert same(resumed.training.trained(), straight.training.trained())
    assert [k.rank for k in resumed.best if k] == [k.rank for k in straight.best if k]
    assert resumed.highest == max((0, 1), key=lambda place: [k.rank for k in resumed.best if k][place])
    earned = [day for report in reports for day in report.earned]
    assert len(earned) == 10 + 10  # of the stopped and resumed run, and of the straight one
    assert earned[0].bill.shape == (2, 3)
    assert all((a.profit == b.profit).all() for a, b in zip(earned[:10], earned[10:], strict=True))
    written = [json.loads(line) for line in (tmp_path / "a" / PROGRESS).read_text().splitlines()]
    assert [day["profit"] for line in written for day in line["earned"]] == [d.profit.tolist() for d in earned[:10]]
    assert len(written[0]["agents"]) == 2
    assert reports[-1].best_gap == [kept and kept.gap for kept in straight.best]
    names = sorted(path.name for path in (tmp_path / "a").glob("*.safetensors"))
    assert names == [
        f"{k}-seed{s}-{p}.safetensors" for k in ("best", "last") for s in (0, 1) for p in ("grid", "prosumers")
    ]
    kept = PolicyFile.load(tmp_path / "a" / "best-seed0-grid.safetensors")
    assert kept.training["command"] == "zengrid train paper"
    with pytest.raises(PolicyError, match="cannot be read"):
        Run.resume(tmp_path / "c")


def test_conventional_policies_change_nothing() -> None:
    for soc_reset in ("daily", "never"):
        evaluator = Evaluator.held_out(PAPER.with_(soc_reset=soc_reset), 14)
        evaluation = evaluator.evaluate(None, None)
        assert evaluation.changes.profit == 0.0
        assert evaluation.gap is not None
        assert evaluation.gap_any_power is not None
        assert (evaluation.gap_any_power.dollars > 0.0).all()
        assert (evaluation.gap.dollars <= evaluation.gap_any_power.dollars + 1e-3).all()


def test_all_five_figures_count() -> None:
    good = Changes(np.array([-39.0, -47.0, -27.0]), 38.0, -31.0)
    assert reaches(good)
    assert good.joint_gain == pytest.approx((39 * 47 * 27 * 38 * 31) ** 0.2)
    for worse in (
        good._replace(profit=36.0),
        good._replace(reserve=-29.0),
        good._replace(bill=good.bill + np.array([0, 2, 0])),
    ):
        assert not reaches(worse)
    assert good._replace(profit=-3.0).joint_gain == -3.0


def judged(profit: float, gap: float | None, bill: float = -1.0) -> Rank:
    """The rank of a market in which every bill, the profit and the gaps are as given, against ones of 1 $. [%]"""

    def outcome(bill: float, profit: float, reserve: float) -> Outcome:
        return Outcome(np.full(3, bill), profit, reserve, 1.0, np.ones(3), 0.0, 0.0)

    after = outcome(1.0 + bill / 100.0, 1.0 + profit / 100.0, 0.9)
    gaps = None if gap is None else Gap(np.zeros(3), np.array([0.0, gap, 0.0]))
    return Evaluation(after, outcome(1.0, 1.0, 1.0), gaps).rank


def test_a_settled_market_is_kept_and_there_the_profit_counts_most() -> None:
    assert judged(10.0, 8.0) > judged(90.0, 8.1)
    assert judged(20.0, 8.0, bill=-10.0) > judged(10.0, 0.0, bill=-50.0)
    assert judged(60.0, 0.0, bill=-60.0) > judged(62.0, 0.0, bill=-30.0)
    assert judged(20.0, 30.0) > judged(20.0, 40.0)
    assert judged(20.0, 9.0, bill=-9.0) > judged(20.0, 9.0)
    assert judged(90.0, 9.0) > judged(90.0, 0.0, bill=1.0)  # nobody's loss is settled
    assert not judged(20.0, None).settled
