"""Trained policies: the file keeps everything, refuses what does not fit, and decides alike alone and in a batch."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from numpy.typing import NDArray
from safetensors import safe_open
from safetensors.numpy import save_file

from support.policy_days import PAPER, facts, grid_view, play
from zengrid.core.observe import ObservationKind, grid_features, prosumer_features
from zengrid.errors import PolicyError
from zengrid.policy.file import Activation, Layer, PolicyFile, Role
from zengrid.policy.network import GridNetwork, Network, ProsumerNetwork, greedy
from zengrid.policy.registry import make_grid_policy, make_prosumer_policy
from zengrid.scenario import Days

Floats = NDArray[np.float64]


def trained(
    role: Role = "prosumer",
    kind: ObservationKind = "public",
    activation: Activation = "tanh",
    homes: tuple[str, ...] = (),
    hidden: tuple[int, ...] = (64, 64),
    seed: int = 0,
) -> PolicyFile:
    """As if it were trained."""
    rng = np.random.default_rng(seed)
    features = prosumer_features(kind) if role == "prosumer" else grid_features(kind, 2, 3)
    levels = np.linspace(-1.0, 1.0, 5) if role == "prosumer" else np.array(PAPER.buy_prices)
    sizes = (len(features), *hidden, levels.size)
    own = (len(homes),) if homes else ()
    layers = [
        Layer(
            rng.normal(0.0, 1.0 / np.sqrt(inputs), (*own, outputs, inputs)).astype(np.float32),
            rng.normal(0.0, 0.3, (*own, outputs)).astype(np.float32),
        )
        for inputs, outputs in pairwise(sizes)
    ]
    return PolicyFile(
        role=role, observation=kind, features=features, offset=rng.normal(size=len(features)),
        scale=rng.uniform(0.5, 2.0, len(features)), levels=levels, activation=activation, layers=tuple(layers),
        dt_h=1.0, name="made-up", homes=homes, training={"scenario": "paper", "seed": seed, "command": "zengrid train"},
    )  # fmt: skip


def by_hand(file: PolicyFile, observation: Floats, home: int = 0) -> Floats:
    """The network as its formula says, one observation at a time."""
    values = (observation - file.offset) * file.scale
    for i, (weight, bias) in enumerate(file.layers):
        if file.homes:
            weight, bias = weight[home], bias[home]
        values = weight.astype(np.float64) @ values + bias.astype(np.float64)
        if i < len(file.layers) - 1:
            values = np.tanh(values) if file.activation == "tanh" else np.maximum(values, 0.0)
    return values


@pytest.mark.parametrize("role", ["prosumer", "grid"])
@pytest.mark.parametrize("homes", [(), ("p2", "p1", "p3")])
def test_a_saved_policy_comes_back_whole(tmp_path: Path, role: Role, homes: tuple[str, ...]) -> None:
    file = trained(role, homes=homes if role == "prosumer" else ())
    file.save(tmp_path / "a.safetensors")
    again = PolicyFile.load(tmp_path / "a.safetensors")
    for name in (
        "role",
        "observation",
        "features",
        "activation",
        "dt_h",
        "name",
        "homes",
        "training",
        "hidden",
        "version",
    ):
        assert getattr(again, name) == getattr(file, name)
    for name in ("offset", "scale", "levels"):
        assert np.array_equal(getattr(again, name), getattr(file, name))
    for mine, theirs in zip(file.layers, again.layers, strict=True):
        assert np.array_equal(mine.weight, theirs.weight)
        assert np.array_equal(mine.bias, theirs.bias)
    assert [path.name for path in tmp_path.iterdir()] == ["a.safetensors"]


def test_the_version_follows_what_decides() -> None:
    file = trained()
    assert len(file.version) == 12
    assert trained().version == file.version
    assert trained(seed=1).version != file.version
    assert replace(file, levels=file.levels * 0.5).version != file.version
    assert replace(file, training={}, name="another").version == file.version


@pytest.mark.parametrize("activation", ["tanh", "relu"])
@pytest.mark.parametrize("homes", [(), ("p1", "p2", "p3")])
@pytest.mark.parametrize("lead", [(), (4,), (2, 3)])
def test_values_follow_the_formula(activation: Activation, homes: tuple[str, ...], lead: tuple[int, ...]) -> None:
    file = trained(activation=activation, homes=homes)
    seen = np.random.default_rng(1).normal(size=(*lead, 3, len(file.features)))
    values = Network(file, homes).q_values(seen)
    assert values.shape == (*lead, 3, 5)
    for index in np.ndindex(*lead, 3):
        np.testing.assert_allclose(values[index], by_hand(file, seen[index], index[-1]), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("homes", [(), ("p1", "p2", "p3")])
@pytest.mark.parametrize("kind", ["paper", "public"])
def test_each_home_alone_and_days_side_by_side_command_the_same(homes: tuple[str, ...], kind: ObservationKind) -> None:
    file, days, market = trained(kind=kind, homes=homes), Days(PAPER), PAPER.market()
    profile = days.days(np.arange(20))
    wide = type(profile)(*(np.moveaxis(column, 1, 0) for column in profile))
    prices = np.random.default_rng(2).choice(PAPER.buy_prices, (24, 20))
    together = play(ProsumerNetwork(file, facts()), market, wide, prices)
    assert len(np.unique(together.battery_kw)) > 1
    for day in range(3):
        for home in range(3):
            one = slice(home, home + 1)
            own = days.day(day)._replace(pv_kw=days.day(day).pv_kw[:, one], load_kw=days.day(day).load_kw[:, one])
            alone = play(
                ProsumerNetwork(file, facts(homes=one)),
                market.with_homes(market.homes.take([home])),
                own,
                prices[:, day],
            )
            assert np.array_equal(alone.battery_kw, together.battery_kw[:, day, one])


def test_commands_are_fractions_of_each_homes_own_power() -> None:
    dear = PAPER.with_(**{"homes.1.battery.charge_max_kw": 5, "homes.2.battery.discharge_max_kw": 0.5})
    file = trained()
    told = facts(dear)
    always = replace(
        file, layers=(*file.layers[:-1], Layer(file.layers[-1].weight * 0, np.eye(5, dtype=np.float32)[4]))
    )
    profile, market = Days(dear).day(0), dear.market()
    assert play(ProsumerNetwork(always, told), market, profile, np.full(24, 0.05)).battery_kw[0].tolist() == [2, 5, 2]
    never = replace(file, layers=(*file.layers[:-1], Layer(file.layers[-1].weight * 0, np.eye(5, dtype=np.float32)[0])))
    played = play(ProsumerNetwork(never, told), market, profile, np.full(24, 0.05))
    assert played.battery_kw[0].tolist() == [-2.0, -2.0, -0.5]


def test_equal_values_mean_the_first_level() -> None:
    assert greedy(np.array([[1.0, 2.0, 2.0], [3.0, 3.0 + 1e-12, 1.0], [-1e6, -1e6 - 1e-6, -1e6 + 1e-3]])).tolist() == [
        1,
        0,
        0,
    ]
    assert greedy(np.array([0.1, 0.3, 0.2])) == 1


@pytest.mark.parametrize("kind", ["paper", "public"])
def test_the_grid_policy_sees_what_it_was_trained_on(kind: ObservationKind) -> None:
    file = trained("grid", kind)
    policy = GridNetwork(file, facts(homes=slice(0)))
    payment = np.array([0.01, 0.02, 0.06])
    view = grid_view(18, payment=payment)
    clock = [np.sin(2 * np.pi * 0.75), np.cos(2 * np.pi * 0.75)]
    seen = [0.6, 3.3, 0.09, 3.0, 21.0, *clock, 0.095] if kind == "public" else [0.6, 3.3, *payment, 21.0]
    expected = by_hand(file, np.array(seen))
    np.testing.assert_allclose(policy.q_values(np.array([seen]))[0], expected, rtol=1e-9)
    assert float(policy.act(view)) == PAPER.buy_prices[int(expected.argmax())]
    many = np.random.default_rng(0).uniform(0.0, 0.1, (50, 3))
    batch = np.asarray(policy.act(grid_view(18, payment=many)))
    assert batch.tolist() == [float(policy.act(grid_view(18, payment=row))) for row in many]


def test_the_public_grid_policy_serves_any_number_of_homes() -> None:
    policy = GridNetwork(trained("grid"), facts(homes=slice(0)))
    assert float(policy.act(grid_view(18, homes=100))) in PAPER.buy_prices


def test_policy_queries_are_answered_for_the_first_home() -> None:
    rows = np.random.default_rng(4).normal(size=(6, 7))
    for homes in ((), ("p3", "p2", "p1")):
        file = trained(homes=homes)
        policy = ProsumerNetwork(file, facts(homes=slice(1, 3)))
        assert policy.levels.tolist() == [-2.0, -1.0, 0.0, 1.0, 2.0]
        assert policy.features == prosumer_features("public")
        expected = [by_hand(file, row, 1) for row in rows]
        np.testing.assert_allclose(policy.q_values(rows), expected, rtol=1e-9)


def test_the_registry_knows_policy_files(tmp_path: Path) -> None:
    for role in get_args(Role):
        trained(role).save(tmp_path / f"{role}.safetensors")
    assert make_prosumer_policy(f"{tmp_path}/prosumer.safetensors", facts()).version == trained().version
    assert make_grid_policy(f"{tmp_path}/grid.safetensors", facts(homes=slice(0))).name == "made-up"
    with pytest.raises(PolicyError, match=r"policy file .*grid\.safetensors: role = grid: a prosumer is wanted"):
        make_prosumer_policy(f"{tmp_path}/grid.safetensors", facts())


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"role": "consumer"}, "role = 'consumer': permitted are grid, prosumer"),
        ({"observation": "all"}, "observation = 'all': permitted are paper, public"),
        ({"activation": "gelu"}, "activation = 'gelu': permitted are tanh, relu"),
        ({"dt_h": 0.0}, "dt_h = 0.0"),
        ({"features": ("soc",)}, "features = soc: a prosumer's public ones are soc, pv_kw"),
        ({"offset": np.zeros(3)}, r"offset has shape \(3,\): it must be \(7,\)"),
        ({"scale": np.full(7, np.inf)}, "scale has numbers that are not finite"),
        ({"levels": np.linspace(-2, 2, 5)}, "battery levels are fractions of full power"),
        ({"levels": np.zeros(1)}, r"levels has shape \(1,\): it must be \(2,\)"),
        ({"levels": np.linspace(-1, 1, 7)}, r"layers.2.weight has shape \(5, 64\): it must be \(7, 64\)"),
        ({"homes": ("p1",)}, r"layers.0.weight has shape \(64, 7\): it must be \(1, 64, 7\)"),
        ({"layers": ()}, "layers: there is none"),
    ],
)
def test_a_policy_that_contradicts_itself_is_refused(change: dict[str, Any], words: str) -> None:
    with pytest.raises(PolicyError, match=words):
        replace(trained(), **change)


QUARTERS = facts(PAPER.with_(slot_minutes=15))
TWO_PRICES = facts(PAPER.with_(buy_prices=[0.05, 0.1]))
PAPER_GRID = GridNetwork(trained("grid", "paper"), facts())


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: ProsumerNetwork(trained(), QUARTERS), "dt_h = 1: the market's slots last 0.25 h"),
        (lambda: ProsumerNetwork(trained(homes=("p1", "p9")), facts()), "home p2: the file has networks for p1, p9"),
        (lambda: GridNetwork(trained("grid"), TWO_PRICES), "buy price = 0.06: permitted are 0.05, 0.1"),
        (lambda: GridNetwork(trained("grid"), replace(facts(), facilities=3)), "features = .* with 3 facilities are"),
        (lambda: PAPER_GRID.act(grid_view()), "join with observation paper"),
        (lambda: PAPER_GRID.act(grid_view(payment=np.zeros(5))), "has 8 numbers, .*: the policy was trained on 6"),
    ],
)
def test_a_policy_that_does_not_fit_the_market_is_refused(make: Callable[[], object], words: str) -> None:
    with pytest.raises(PolicyError, match=words):
        make()


def test_a_file_that_is_none_or_was_changed_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.safetensors"
    trained().save(path)
    with safe_open(path, framework="numpy") as opened:
        metadata = opened.metadata()
        tensors = {name: opened.get_tensor(name) for name in opened.keys()}  # noqa: SIM118 - no dictionary

    def refused(words: str) -> None:
        with pytest.raises(PolicyError, match=f"policy file .*: {words}") as error:
            PolicyFile.load(path)
        assert len(str(error.value)) < 1000

    save_file({**tensors, "layers.0.bias": tensors["layers.0.bias"] + 1}, path, metadata)
    refused("was changed since it was saved")
    save_file({**tensors, "layers.0.bias": tensors["layers.0.bias"].astype(np.float64)}, path, metadata)
    refused("layers.0.bias is float64: permitted is float32")
    save_file({**tensors, "extra": tensors["layers.0.bias"]}, path, metadata)
    refused("tensors .*extra")
    save_file(tensors, path, {**metadata, "format": "something/2"})
    refused("format = 'something/2', permitted is 'zengrid.policy/1'")
    save_file(tensors, path)
    refused("format = None")
    save_file(tensors, path, {name: text for name, text in metadata.items() if name != "scale"})
    refused("lacks or misspells 'scale'")
    save_file(tensors, path, {**metadata, "levels": json.dumps("all")})
    refused("lacks or misspells")
    for name, wrong in (
        ("training", "[" * 100_000), ("training", "[]"), ("name", "null"), ("name", '"\\u001b[31m"'), ("dt_h", '"1"'),
        ("levels", f"[{'9' * 400}, 1]"), ("homes", "3"), ("role", "{}"), ("scale", "NaN"),
        ("features", json.dumps("x" * 10**6)),
    ):  # fmt: skip
        save_file(tensors, path, {**metadata, name: wrong})
        refused("")
    for dtype, size in (("BF16", 2), ("F8_E4M3", 1), ("C64", 8)):
        number = {"dtype": dtype, "shape": [1], "data_offsets": [0, size]}
        other = {"dtype": "F32", "shape": [1], "data_offsets": [size, size + 4]}
        header = {"__metadata__": metadata, "layers.0.bias": number, "layers.0.weight": other}
        text = json.dumps(header).encode()
        path.write_bytes(len(text).to_bytes(8, "little") + text + bytes(size + 4))
        refused("layers.0.bias is .*: permitted is float32")
    path.write_bytes(b"not a policy")
    refused("cannot be read")
    with pytest.raises(PolicyError, match="cannot be read"):
        PolicyFile.load(tmp_path / "missing.safetensors")
