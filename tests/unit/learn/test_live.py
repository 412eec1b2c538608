"""A learner in a running market: it finds out what pays, remembers what really was, and goes on where it stopped."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch", reason="extra learn is not installed")

import torch

from support.policy_days import PAPER
from zengrid.core.baselines import conventional
from zengrid.env.facts import market_facts
from zengrid.env.vector import VectorMarket
from zengrid.errors import PolicyError
from zengrid.learn.live_agents import GridLearner, ProsumerLearner
from zengrid.learn.live_settings import Live
from zengrid.learn.memory import Memory
from zengrid.learn.replay import Replay
from zengrid.policy.file import Role
from zengrid.policy.network import ProsumerNetwork
from zengrid.policy.tensor_file import TensorFile, write_tensors
from zengrid.scenario import Days

NEVER = PAPER.with_(soc_reset="never")
HOME = slice(1, 2)


def quick(role: Role, seed: int = 0, **learning: Any) -> Live:
    """Settings of a learner that is done with exploring, and forgets, within a test."""
    live = Live.of(role, seed=seed, slots=400)
    return replace(live, learning=replace(live.learning, memory=500, **learning))


class OneHome:
    """The paper's second home under a price that is high in the evening, slot by slot as a clock would tell it."""

    def __init__(self, learner: ProsumerLearner) -> None:
        self.learner = learner
        self.vector = VectorMarket(NEVER.market(), (), np.array(NEVER.buy_prices))
        self.days = Days(NEVER)
        self.day = -1
        self.bills: list[float] = []
        self.commands: list[float] = []
        self.told: tuple[int, int, np.ndarray[Any, Any], bool] | None = None

    def play(self, slots: int, deaf: range = range(0)) -> None:
        """Some slots; in those of ``deaf`` the learner hears nothing and the rule decides."""
        for number in range(slots):
            if self.day < 0 or self.vector.over:
                self.day += 1
                soc = self.vector.market.homes.soc_initial if self.day == 0 else None
                self.vector.begin(self.days.day(self.day), soc, self.day)
            slot = self.vector.slot
            price = 0.10 if 18 <= slot < 22 else 0.05
            view = self.vector.prosumer_view(price, HOME)
            rule = conventional(self.vector.now.pv_kw, self.vector.now.load_kw, self.vector.market.homes)
            command = None
            if number not in deaf:
                if self.told is not None:
                    self.learner.hear(*self.told)
                command = self.learner.act(view)
            if command is not None:
                rule[HOME] = command
            settled = self.vector.step(price, rule)
            self.told = (self.day, slot, -settled.bill[HOME], number in deaf)
            self.bills.append(float(settled.bill[1]))
            self.commands.append(float(rule[1]))
            if number not in deaf:
                self.learner.learn()


def learner(seed: int = 0, **learning: Any) -> ProsumerLearner:
    return ProsumerLearner("p2", market_facts(NEVER, ("p2",)), quick("prosumer", seed, every=1, **learning))


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_home_learns_what_pays_and_acts_as_its_file_says() -> None:
    market = OneHome(learner())
    market.play(24 * 20)
    rule = OneHome(learner())
    rule.play(24 * 20, deaf=range(24 * 20))
    assert market.bills[:24] == rule.bills[:24]  # at first it watches
    assert sum(market.bills[-120:]) < 0.8 * sum(rule.bills[-120:])
    facts = market_facts(NEVER, ("p2",))
    network = ProsumerNetwork(market.learner.file(), facts)
    market.learner.live = replace(market.learner.live, learning=replace(market.learner.live.learning, every=10**9))
    assert market.learner.dqn is not None
    market.learner.dqn.learning = replace(market.learner.dqn.learning, epsilon_end=0.0)
    for _ in range(48):
        if market.vector.over:
            market.play(1)
        view = market.vector.prosumer_view(0.07, HOME)
        assert np.array_equal(market.learner.act(view), network.act(view))  # type: ignore[arg-type]
        market.play(1)


def test_saved_and_restored_it_goes_on_exactly(tmp_path: Path) -> None:
    path = tmp_path / "p2.checkpoint"
    whole, first = OneHome(learner(3)), OneHome(learner(3))
    whole.play(120)
    first.play(120)
    first.learner.save(path)
    # The slot in between was seen by a process that is gone: both must forget it.
    again = learner(3)
    again.restore(path)
    assert (again.slots, again.progress) == (first.learner.slots, first.learner.progress)
    whole.learner._seen, first.learner = None, again
    whole.play(60)
    first.play(60)
    assert whole.commands == first.commands
    assert whole.learner.file().version == first.learner.file().version
    assert ProsumerNetwork.load(path.with_suffix(".safetensors"), market_facts(NEVER, ("p2",))).name == "p2-learning"


def test_what_does_not_fit_is_refused_and_kept(tmp_path: Path) -> None:
    path = tmp_path / "p2.checkpoint"
    learner().save(path)
    other = ProsumerLearner("p1", market_facts(NEVER, ("p1",)), quick("prosumer"))
    with pytest.raises(PolicyError, match="agent = p2, here it is p1"):
        other.restore(path)
    path.write_bytes(b"half a file")
    with pytest.raises(PolicyError, match="cannot be read"):
        learner().restore(path)
    assert path.read_bytes() == b"half a file"


@pytest.fixture(scope="module")
def begun(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a learner left that has begun to act."""
    market, path = OneHome(learner()), tmp_path_factory.mktemp("begun") / "p2.checkpoint"
    market.play(30)
    market.learner.save(path)
    return path


@pytest.mark.parametrize(
    ("name", "new", "words"),
    [
        ("levels", [-1.0, 1.0], r"levels = \(-1.0, 1.0\), here it is"),
        ("agent", "p" * 10**5, r"agent = p{97}\.\.\., here it is p2"),
        ("dt_h", "1.0", "dt_h = '1.0'"),
        ("slots", -1, "slots = -1"),
        ("last", [1], "last.1"),
        ("begun.features", ["soc"], "features = soc: here they are soc, pv_kw"),
        ("begun.offset", [0.0], "offset has 1 numbers: there are 7 features"),
        ("begun.scale", [-1.0] * 7, "begun.scale.0 = -1.0"),
        ("begun.hidden", [10**8], r"dqn.online.0 is float32\[1, 7, 64\]: it must be float32\[1, 7, 100000000\]"),
        ("begun.hidden", [], "it must be"),
        ("begun.activation", "gelu", "begun.activation = 'gelu'"),
        ("begun.reward_scale", float("inf"), "begun.reward_scale = inf"),
        ("begun", None, "dqn.* is unknown"),
        ("dqn.replay.gap", np.full(500, 2, np.uint8).view(bool), "dqn.replay.gap has truth values that are neither"),
        ("dqn.replay.action", np.full((500, 1, 1), 5), "dqn.replay.action has numbers from 5"),
        ("dqn.online.0", np.full((1, 7, 64), np.inf, np.float32), "dqn.online.0 has numbers that are not finite"),
        ("generator", np.zeros(3, np.uint8), r"generator is uint8\[3\]"),
    ],
)
def test_what_no_learner_left_is_refused_and_changes_nothing(
    begun: Path, tmp_path: Path, name: str, new: Any, words: str
) -> None:
    with TensorFile(begun) as file:
        arrays, values = file.read(), json.loads(file.texts["values"])
    if isinstance(new, np.ndarray):
        arrays[name] = new
    else:
        *steps, last = name.split(".")
        reduce(getitem, steps, values)[last] = new
    path = tmp_path / "p2.checkpoint"
    write_tensors(path, arrays, {"format": "zengrid.learner/1", "values": json.dumps(values)})
    other = learner()
    with pytest.raises(PolicyError, match=f"learner {path}: .*{words}"):
        other.restore(path)
    assert (other.watches, other.slots) == (True, 0)
    other.restore(begun)
    assert (other.watches, other.slots) == (False, 29)


def test_a_policy_to_start_from_has_a_usable_scale_of_rewards() -> None:
    market = OneHome(learner())
    market.play(30)
    file = market.learner.file()
    for wrong in (0.0, -1.0, float("nan"), "large", None, [1.0]):
        start = replace(file, training={**file.training, "reward_scale": wrong})
        with pytest.raises(PolicyError, match=r"reward_scale = .*a number above 0"):
            ProsumerLearner("p2", market_facts(NEVER, ("p2",)), quick("prosumer"), start=start)


def test_missed_slots_are_gaps_in_what_it_remembers() -> None:
    market = OneHome(learner(own_model=False))
    market.play(60)
    market.play(10, deaf=range(3, 7))
    memory = market.learner._memory
    # On the first day and in two slots more the rule decided; of the slot before the silence it never heard again.
    assert (memory.written, memory.gaps) == (59 - 26 + 3 + 2, 2)
    drawn = memory.draw(256, torch.Generator().manual_seed(0))
    time_now, time_next = drawn.seen[0, :, 4:6].double().numpy(), drawn.seen_next[0, :, 4:6].double().numpy()
    turned = np.arctan2(time_next[:, 0], time_next[:, 1]) - np.arctan2(time_now[:, 0], time_now[:, 1])
    np.testing.assert_allclose(turned % (2 * np.pi), 2 * np.pi / 24, atol=1e-5)


def test_a_memory_without_gaps_is_a_plain_one() -> None:
    plain = Replay(8, 1, 1, 1, 2, 0.9, torch.device("cpu"))
    memory = Memory.like(plain)
    for number in range(13):
        row = torch.full((1, 1, 1), float(number)), torch.zeros((1, 1), dtype=torch.int64), torch.ones((1, 1))
        plain.add(*row, 0.0, True)
        memory.follow(number != 0)
        memory.add(*row, 0.0, True)
    one, other = (it.draw(50, torch.Generator().manual_seed(1)) for it in (plain, memory))
    assert all(torch.equal(a, b) for a, b in zip(one, other, strict=True))
    memory.follow(False)
    memory.add(torch.full((1, 1, 1), 99.0), torch.zeros((1, 1), dtype=torch.int64), torch.ones((1, 1)), 0.0, True)
    assert memory.draw(100, torch.Generator()).seen_next.max() < 99


def test_the_grid_takes_the_price_that_really_held() -> None:
    grid = GridLearner(market_facts(NEVER), quick("grid"))
    vector = VectorMarket(NEVER.market(), (), np.array(NEVER.buy_prices))
    vector.begin(Days(NEVER).day(0), NEVER.market().homes.soc_initial, 0)
    for number in range(30):
        day, slot = divmod(number, 24)
        grid.act(vector.grid_view()._replace(day=day, slot=slot))
        grid.hear(day, slot, 0.5, 0.09)
        grid.learn()
    memory = grid._memory
    assert memory.written == 30
    assert set(memory.action[:30].flatten().tolist()) == {NEVER.buy_prices.index(0.09)}
