"""A checkpoint from a stranger: it is gone on from exactly, or refused with a reason; nothing in it ever runs."""

from __future__ import annotations

import io
import json
import math
import os
import pickle
import zipfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("torch", reason="extra learn is not installed")

import torch

from support.policy_days import PAPER
from zengrid.env.facts import market_facts
from zengrid.errors import PolicyError
from zengrid.learn.checkpoint import NumpyGenerator
from zengrid.learn.live_agents import ProsumerLearner
from zengrid.learn.live_settings import Live
from zengrid.learn.run import CHECKPOINT, PROGRESS, Plan, Run
from zengrid.learn.settings import Settings
from zengrid.policy.file import PolicyFile
from zengrid.policy.tensor_file import TensorFile, write_tensors
from zengrid.policy.trained import FOLDER, GENERIC
from zengrid.scenario import dumps

Arrays = dict[str, NDArray[Any]]
Texts = dict[str, Any]
TINY = Settings.preset("fast").with_(days=4, pool=16, steps=96, memory=400, hidden=(8,), batch=8)


class Bomb:
    """What Python would run when it unpickled this."""

    def __init__(self, trace: Path) -> None:
        self.trace = trace

    def __reduce__(self) -> tuple[Any, ...]:
        return (os.mkdir, (str(self.trace),))


def a_torch_archive(bomb: Bomb) -> bytes:
    buffer = io.BytesIO()
    torch.save({"plan": bomb}, buffer)
    return buffer.getvalue()


def a_zip_bomb(bomb: Bomb) -> bytes:
    """A thousand times as large as it looks."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("archive/data.pkl", pickle.dumps(bomb))
        archive.writestr("archive/data/0", bytes(2**26))
    return buffer.getvalue()


PICKLES: dict[str, Callable[[Bomb], bytes]] = {
    "pickle": pickle.dumps,
    "old pickle": lambda bomb: pickle.dumps(bomb, protocol=0),
    "torch": a_torch_archive,
    "zip bomb": a_zip_bomb,
}


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a training that was stopped after two of its four days."""
    folder = tmp_path_factory.mktemp("trained")
    run = Run(folder, Plan((PAPER,) * 2, (0, 1), TINY, "public", "zengrid train paper"))
    assert not run.go(lambda report: None, stop=lambda: run.training.step >= 48, every=2)
    return folder


@pytest.fixture
def folder(trained: Path, tmp_path: Path) -> Iterator[Path]:
    """A copy of it, which no test may change beyond the checkpoint."""
    for path in trained.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.name != CHECKPOINT}
    yield tmp_path
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.name != CHECKPOINT} == before


def refused(folder: Path, *words: str) -> None:
    """The error names the file and what is wrong with it."""
    with pytest.raises(PolicyError) as error:
        Run.resume(folder)
    for word in (f"checkpoint {folder / CHECKPOINT}: ", *words):
        assert word in str(error.value)
    assert len(str(error.value)) < 1000


def change(path: Path, edit: Callable[[Arrays, Texts], object]) -> None:
    """Change arrays and values of a checkpoint."""
    with TensorFile(path) as file:
        arrays, texts = file.read(), dict(file.texts)
    values = json.loads(texts["values"])
    edit(arrays, values)
    write_tensors(path, arrays, {**texts, "values": json.dumps(values)})


def put(name: str, array: Any) -> Callable[[Arrays, Texts], object]:
    return lambda arrays, values: arrays.update({name: array})


def at(name: str, number: float) -> Callable[[Arrays, Texts], object]:
    def edit(arrays: Arrays, values: Texts) -> None:
        arrays[name].flat[0] = number

    return edit


def value(path: str, new: Any) -> Callable[[Arrays, Texts], object]:
    def edit(arrays: Arrays, values: Texts) -> None:
        *steps, last = path.split(".")
        for step in steps:
            values = values[step]
        values[last] = new

    return edit


# ---------------------------------------------------------------- code and formats


@pytest.mark.parametrize("kind", PICKLES)
def test_nothing_in_a_pickle_ever_runs(kind: str, folder: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    trace = tmp_path_factory.mktemp("trace") / "was here"
    content = PICKLES[kind](Bomb(trace))
    if kind != "zip bomb":
        torch_or_pickle = (
            pickle.loads if "pickle" in kind else lambda it: torch.load(io.BytesIO(it), weights_only=False)
        )
        torch_or_pickle(content)
        assert trace.exists()  # the bomb is real
        trace.rmdir()
    (folder / CHECKPOINT).write_bytes(content)
    refused(folder, "cannot be read")
    learner = ProsumerLearner("p2", market_facts(PAPER, ("p2",)), Live.of("prosumer"))
    with pytest.raises(PolicyError, match=r"learner .*: cannot be read"):
        learner.restore(folder / CHECKPOINT)
    with pytest.raises(PolicyError, match=r"policy file .*: cannot be read"):
        PolicyFile.load(folder / CHECKPOINT)
    assert not trace.exists()


def test_a_file_that_was_cut_off_is_refused_wherever(folder: Path) -> None:
    whole = (folder / CHECKPOINT).read_bytes()
    for length in (0, 7, 8, 9, 1000, len(whole) // 2, len(whole) - 1):
        (folder / CHECKPOINT).write_bytes(whole[:length])
        refused(folder, "cannot be read")
    (folder / CHECKPOINT).write_bytes(whole + b"\0")
    refused(folder, "cannot be read")


def test_bytes_changed_at_random_are_gone_on_from_or_refused(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    whole = (folder / CHECKPOINT).read_bytes()
    header = 8 + int.from_bytes(whole[:8], "little")
    rng = np.random.default_rng(0)
    for _ in range(60):
        changed = bytearray(whole)
        for place in rng.integers(header, size=3):
            changed[place] = rng.integers(256)
        (folder / CHECKPOINT).write_bytes(changed)
        with suppress(PolicyError):
            Run.resume(folder)
    assert capfd.readouterr().err == ""


def test_what_is_no_file_is_refused(folder: Path) -> None:
    path = folder / CHECKPOINT
    path.unlink()
    refused(folder, "cannot be read (No such file or directory)")
    os.mkfifo(path)
    refused(folder, "not a regular file")
    path.unlink()
    path.symlink_to("/dev/zero")
    refused(folder, "not a regular file")
    path.unlink()
    path.mkdir()
    refused(folder, "not a regular file")
    path.rmdir()


def test_a_file_of_another_kind_or_version_is_refused(folder: Path) -> None:
    path = folder / CHECKPOINT
    path.write_bytes((FOLDER / f"{GENERIC}.safetensors").read_bytes())
    refused(folder, "format = 'zengrid.policy/1', permitted is 'zengrid.training/")
    write_tensors(path, {"a": np.zeros(3)}, {})
    refused(folder, "format = None")


def test_sizes_are_judged_before_anything_is_read(folder: Path) -> None:
    path = folder / CHECKPOINT
    most = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    with _saved(folder) as saved:
        texts = saved.texts
    with path.open("r+b") as file:
        file.truncate(most + 1)  # takes no room on the disk
    refused(folder, f"has {most + 1} bytes; permitted are {most}")
    # Within the memory, but no array of this training.
    numbers = most // 16
    header = {"__metadata__": texts, "huge": {"dtype": "F64", "shape": [numbers], "data_offsets": [0, 8 * numbers]}}
    text = json.dumps(header).encode()
    with path.open("wb") as file:
        file.write(len(text).to_bytes(8, "little") + text)
        file.truncate(8 + len(text) + 8 * numbers)
    refused(folder, "generator is missing")


def test_a_plan_cannot_ask_for_more_than_the_file_holds(folder: Path) -> None:
    change(folder / CHECKPOINT, value("plan.settings.prosumer.hidden", [10**8, 10**8]))
    refused(folder, "prosumers.online.0 is float32[6, 7, 8]: it must be float32[6, 7, 100000000]")


# ---------------------------------------------------------------- arrays and values


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (put("grid.online.0", np.zeros((2, 8, 9), np.float32)), "grid.online.0 is float32[2, 8, 9]: it must be"),
        (put("grid.online.0", np.zeros((2, 8, 8), np.float64)), "grid.online.0 is float64"),
        (put("extra", np.zeros(3)), "extra is unknown: there is no such array"),
        (lambda arrays, values: arrays.pop("generator"), "generator is missing: it must be uint8["),
        (put("generator", np.zeros(5, np.uint8)), "generator is uint8[5]"),
        (lambda arrays, values: arrays["generator"].fill(255), "generator is no state of torch's random numbers"),
        (at("prosumers.averaged.1", np.nan), "prosumers.averaged.1 has numbers that are not finite"),
        (at("grid.exp_avg_sq.0", -1.0), "grid.exp_avg_sq.0 has numbers from -1"),
        (at("grid.replay.action", 6), "grid.replay.action has numbers from 0 to 6: permitted are 0 to 5"),
        (at("prosumers.replay.action", -1), "prosumers.replay.action has numbers from -1"),
        (at("prosumers.replay.goes_on", 2.0), "prosumers.replay.goes_on has numbers from 0 to 2"),
        (at("market.soc", 1.5), "market.soc has numbers from"),
        (value("training.step", 47), "step = 47: permitted are whole days of 24 slots"),
        (value("training.step", 48.0), "training.step = 48.0"),
        (value("training.step", -24), "training.step = -24"),
        (value("training.step", 10**30), "training.step = 1"),
        (value("training.step", True), "training.step = True"),
        (value("training.grid.updates", "5"), "training.grid.updates = '5'"),
        (value("training.rng.state", -1), "training.rng.state = -1"),
        (value("training.rng.inc", 2**128), "training.rng.inc = "),
        (value("training.more", 1), "training.more = 1"),
        (value("seconds", float("nan")), "seconds = nan"),
        (value("best", []), "best: permitted are 2 markets of 3 homes"),
        (value("best", [{"bill": "all"}, None]), "best.0"),
        (value("earned", [{"bill": [[1.0]], "profit": [1.0], "reserve_kwh": [1.0]}]), "earned: permitted are days"),
        (value("plan", {}), "plan.scenarios"),
        (value("plan.seeds", [0]), "plan.scenario_of: permitted is one of 1 scenarios for each of the seeds"),
        (value("plan.scenario_of", [0, 1]), "plan.scenario_of"),
        (value("plan.observation", "all"), "plan.observation = 'all'"),
        (value("plan.scenarios", ["name: x"]), "scenario"),
        (value("plan.scenarios", ["[" * 100_000]), "nested deeper than 50 levels"),
        (value("plan.settings.days", -1), "setting days = -1: permitted: 1 or more"),
        (value("plan.settings.days", 2**70), "setting days = "),
        (value("plan.settings.grid.lr", "fast"), "setting grid_lr = fast"),
        (value("plan.settings.grid", None), "setting grid = None"),
    ],
)  # fmt: skip
def test_what_no_training_left_is_refused(edit: Callable[[Arrays, Texts], object], words: str, folder: Path) -> None:
    change(folder / CHECKPOINT, edit)
    refused(folder, words)


@pytest.mark.parametrize("text", ["", "{", "[" * 100_000, '{"a":' * 100_000, "null", '"\\ud800"', "1" * 5000])
def test_values_that_are_no_json_of_ours_are_refused(text: str, folder: Path) -> None:
    with _saved(folder) as saved:
        arrays, texts = saved.read(), saved.texts
    write_tensors(folder / CHECKPOINT, arrays, {**texts, "values": text})
    refused(folder)


def test_markets_that_do_not_go_together_are_refused(folder: Path) -> None:
    fewer = PAPER.with_(homes=[home.model_dump() for home in PAPER.homes[:2]])

    def edit(arrays: Arrays, values: Texts) -> None:
        values["plan"] |= {"scenarios": [dumps(PAPER), dumps(fewer)], "scenario_of": [0, 1]}

    change(folder / CHECKPOINT, edit)
    refused(folder, "number of homes: markets trained side by side must have the same")


def test_a_refused_state_leaves_a_training_as_it_was(folder: Path) -> None:
    run = Run.resume(folder)
    good = run.training.state()
    before = {name: tensor.clone() for name, tensor in good.tensors.items()}
    for name, wrong in (("prosumers.averaged.3", math.nan), ("generator", 255), ("market.soc", -1)):
        changed = {each: it + 1 for each, it in before.items() if each.startswith(("grid.online", "prosumers.step"))}
        tensors = {**before, **changed, name: torch.full_like(before[name], wrong)}
        with pytest.raises(PolicyError, match=name):
            run.training.restore(good._replace(tensors=tensors))
        after = run.training.state()
        assert after.values == good.values
        assert all(torch.equal(after.tensors[each], before[each]) for each in before)


def test_progress_that_is_none_is_refused(folder: Path) -> None:
    for line in ("nothing\n", "{}\n", "[" * 100_000 + "\n"):
        # What the fixture compares is what was there before.
        before = (folder / PROGRESS).read_bytes()
        (folder / PROGRESS).write_bytes(before + line.encode())
        refused(folder, f"{PROGRESS} beside it has a line that is no evaluation")
        assert (folder / PROGRESS).read_bytes() == before + line.encode()
        (folder / PROGRESS).write_bytes(before)


def test_a_generator_goes_on_exactly() -> None:
    generator = np.random.default_rng([3, 4])
    generator.integers(7, size=3, dtype=np.int32)  # half a word is left over
    text = NumpyGenerator.of(generator).model_dump_json()
    again = NumpyGenerator.model_validate_json(text).made()
    assert again.bit_generator.state == generator.bit_generator.state
    assert (again.integers(9, size=50) == generator.integers(9, size=50)).all()


def _saved(folder: Path) -> TensorFile:
    return TensorFile(folder / CHECKPOINT)
