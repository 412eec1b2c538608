"""The supervisor with real processes, forked and in fresh interpreters."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

from zengrid.processes import ProcessEvent, ProcessSpec, Restarts, Signals, Supervisor
from zengrid.processes.start import Start, fork, spawn

DEADLINE_S = 20.0
QUICK = Restarts(limit=3, first_s=0.01, longest_s=0.02)

MODULES = {
    "good": "",
    "bad": "import sys; sys.exit('no such\\nthing')",
    "broken": "1 / 0",
    "patient": "import signal, sys; print('ready', flush=True); signal.sigwaitinfo([signal.SIGUSR1])",
    "deaf": """
import signal
signal.signal(signal.SIGTERM, signal.SIG_IGN)
print('ready', flush=True)
signal.sigwaitinfo([signal.SIGUSR1])
""",
    "curious": """
import os, signal, sys
print(sys.argv[1:], os.environ.get('COLOUR'), sorted(map(int, signal.pthread_sigmask(signal.SIG_BLOCK, ()))))
print(signal.getsignal(signal.SIGINT) is signal.default_int_handler, signal.getsignal(signal.SIGTERM) is signal.SIG_DFL)
print(os.getsid(0) == os.getpid(), sys.stdin.read() == '')
print(open('/proc/self/cmdline').read().strip(chr(0)))
""",
    "twice": "import sys; sys.exit(0 if '--again' in sys.argv else 3)",
    "parent": """
import sys
from pathlib import Path
from zengrid.processes import ProcessSpec, Signals, Supervisor
from zengrid.processes import start
folder = Path(sys.argv[2])
with Signals() as signals, Supervisor(lambda event: None, getattr(start, sys.argv[1])) as supervisor:
    supervisor.start(ProcessSpec('child', 'deaf', log=folder / 'child.log'))
    print(supervisor.pid('child'), flush=True)
    while not signals.wait(supervisor.poll()):
        pass
""",
}


@pytest.fixture(autouse=True)
def modules(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, source in MODULES.items():
        (tmp_path / f"{name}.py").write_text(source)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), *sys.path]))


@pytest.fixture(params=[fork, spawn], ids=["fork", "spawn"])
def start(request: pytest.FixtureRequest) -> Start:
    chosen: Start = request.param
    return chosen


class House:
    """A supervisor with its signals and everything it told."""

    def __init__(self, start: Start, folder: Path) -> None:
        self.events: list[ProcessEvent] = []
        self.folder = folder
        self.supervisor = Supervisor(self.events.append, start)
        self.signals = Signals()

    def start(self, module: str, *arguments: str, **settings: object) -> None:
        settings.setdefault("restarts", QUICK)
        spec = ProcessSpec(module, module, arguments, log=self.folder / f"{module}.log", **settings)  # type: ignore[arg-type]
        self.supervisor.start(spec)

    def until(self, condition: Callable[[], object]) -> signal.Signals | None:
        deadline = time.monotonic() + DEADLINE_S
        while not condition():
            left = deadline - time.monotonic()
            assert left > 0, f"in vain: {self.events}, {self.logs()}"
            # Logs are written without a signal: look often.
            if asked := self.signals.wait(min(self.supervisor.poll(), left, 0.01)):
                return asked
        return None

    def kinds(self, name: str) -> list[str]:
        return [event.kind for event in self.events if event.name == name]

    def log(self, name: str) -> str:
        path = self.folder / f"{name}.log"
        return path.read_text() if path.exists() else ""

    def logs(self) -> dict[str, str]:
        return {name: self.log(name) for name in MODULES}


@pytest.fixture
def house(start: Start, tmp_path: Path) -> Iterator[House]:
    it = House(start, tmp_path)
    with it.signals, it.supervisor:
        yield it


def test_work_that_is_done_is_not_started_again(house: House) -> None:
    house.start("good")
    house.until(lambda: not house.supervisor.alive())
    assert house.kinds("good") == ["started", "ended"]
    assert house.supervisor.code("good") == 0


def test_a_process_that_keeps_failing_is_given_up_and_quoted(house: House) -> None:
    house.start("bad")
    house.until(lambda: not house.supervisor.alive())
    assert house.kinds("bad") == ["started", "failed", "started", "failed", "started", "gave_up"]
    assert house.events[-1].text == "bad: exit code 1, 3 failures within 60 s; given up"
    assert house.supervisor.last_log_lines("bad") == ["no such", "thing"]


def test_an_exception_ends_up_in_the_log(house: House) -> None:
    house.start("broken", restarts=Restarts(unrecoverable_within_s=10.0))
    house.until(lambda: not house.supervisor.alive())
    assert house.kinds("broken") == ["started", "unrecoverable"]
    assert house.supervisor.last_log_lines("broken")[-1] == "ZeroDivisionError: division by zero"


def test_failures_of_long_ago_are_forgiven(house: House) -> None:
    house.start("bad", restarts=Restarts(limit=2, window_s=0.0, first_s=0.001))
    house.until(lambda: len(house.kinds("bad")) > 8)
    assert "gave_up" not in house.kinds("bad")


def test_a_killed_process_is_started_again(house: House) -> None:
    house.start("patient")
    house.until(lambda: "ready" in house.log("patient"))
    first = house.supervisor.pid("patient")
    assert first is not None
    os.kill(first, signal.SIGKILL)
    house.until(lambda: house.log("patient").count("ready") == 2)
    assert house.kinds("patient") == ["started", "failed", "started"]
    assert house.events[1].text == "patient: killed by SIGKILL; starting it again in 0.0 s"
    assert house.supervisor.pid("patient") not in (None, first)


def test_a_restarted_process_gets_its_options_for_a_restart(house: House) -> None:
    house.start("twice", again=("--again",))
    house.until(lambda: not house.supervisor.alive())
    assert house.kinds("twice") == ["started", "failed", "started", "ended"]


def test_a_process_gets_its_arguments_environment_and_title(house: House) -> None:
    house.start("curious", "a b", "c", title="zengrid curious one", environment={"COLOUR": "green"})
    house.until(lambda: not house.supervisor.alive())
    assert house.log("curious").splitlines()[1:] == [
        "['a b', 'c'] green []",
        "True True",
        "True True",
        "zengrid curious one",
    ]


def test_stopping_ends_it_for_good(house: House) -> None:
    house.start("patient")
    house.until(lambda: "ready" in house.log("patient"))
    house.supervisor.stop("patient")
    house.until(lambda: not house.supervisor.alive())
    assert house.kinds("patient") == ["started", "ended"]
    assert house.supervisor.code("patient") == -signal.SIGTERM


def test_one_that_does_not_listen_is_killed(house: House) -> None:
    house.start("deaf")
    house.until(lambda: "ready" in house.log("deaf"))
    house.supervisor.stop("deaf", within_s=0.05)
    house.until(lambda: not house.supervisor.alive())
    assert house.supervisor.code("deaf") == -signal.SIGKILL


def test_stopping_one_that_waits_to_be_started_again(house: House) -> None:
    house.start("bad", restarts=Restarts(first_s=1000.0, longest_s=1000.0))
    house.until(lambda: "failed" in house.kinds("bad"))
    assert house.supervisor.alive() == ["bad"]
    house.supervisor.stop("bad")
    assert house.supervisor.alive() == []


def test_released_processes_may_fail(house: House) -> None:
    house.start("bad", restarts=Restarts(first_s=1000.0, longest_s=1000.0))
    house.start("patient")
    house.until(lambda: "failed" in house.kinds("bad") and "ready" in house.log("patient"))
    house.supervisor.stop_restarting()
    assert house.supervisor.alive() == ["patient"]
    pid = house.supervisor.pid("patient")
    assert pid is not None
    os.kill(pid, signal.SIGKILL)
    house.until(lambda: not house.supervisor.alive())
    assert house.kinds("patient") == ["started", "ended"]


def test_it_is_looked_after_until_the_time_is_up(house: House) -> None:
    house.start("patient")
    assert house.supervisor.supervise(house.signals, within_s=0.01) is None
    assert house.supervisor.alive() == ["patient"]


def test_it_is_looked_after_until_those_that_matter_have_ended(house: House) -> None:
    house.start("patient")
    house.start("twice")
    assert house.supervisor.supervise(house.signals, ["twice"], within_s=DEADLINE_S) is None
    assert house.supervisor.alive() == ["patient"]
    assert house.supervisor.code("twice") == 3


def test_leaving_the_block_leaves_nobody(start: Start, tmp_path: Path) -> None:
    house = House(start, tmp_path)
    with house.signals, house.supervisor:
        house.start("deaf")
        house.until(lambda: "ready" in house.log("deaf"))
        pid = house.supervisor.pid("deaf")
    assert pid is not None
    assert not psutil.pid_exists(pid)


def test_signals_that_ask_to_end_reach_the_supervisor(house: House) -> None:
    house.start("patient")
    # To this thread alone: others of the test runner's process do not block it.
    signal.pthread_kill(threading.get_ident(), signal.SIGINT)
    assert house.supervisor.supervise(house.signals, within_s=DEADLINE_S) is signal.SIGINT


def test_no_process_outlives_a_supervisor_that_is_killed(start: Start, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "parent", start.__name__, str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        child = psutil.Process(int(parent.stdout.readline()))
        deadline = time.monotonic() + DEADLINE_S
        log = tmp_path / "child.log"
        while not (log.exists() and "ready" in log.read_text()):
            assert time.monotonic() < deadline
        parent.kill()
    # Whoever inherits it may leave it unburied: a zombie has ended, too.
    _, alive = psutil.wait_procs([child], timeout=0)
    while alive and alive[0].status() != psutil.STATUS_ZOMBIE:
        assert time.monotonic() < deadline
        _, alive = psutil.wait_procs(alive, timeout=0.01)


def test_a_process_cannot_be_started_twice(house: House) -> None:
    house.start("patient")
    with pytest.raises(ValueError, match="patient: runs already"):
        house.start("patient")


def test_one_that_cannot_be_started_is_given_up(tmp_path: Path) -> None:
    def refuse(spec: ProcessSpec, arguments: object) -> int:
        raise BlockingIOError("Resource temporarily unavailable")

    house = House(refuse, tmp_path)
    with house.signals, house.supervisor:
        house.start("good")
        house.until(lambda: not house.supervisor.alive())
    assert house.kinds("good") == ["failed", "failed", "gave_up"]
    assert "cannot be started: Resource temporarily unavailable" in house.events[0].text


def test_a_log_that_grows_while_its_process_runs_is_bounded(house: House, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("zengrid.processes.process_log.MAX_BYTES", 35)
    monkeypatch.setattr("zengrid.processes.supervisor.LOG_CHECK_S", 0.0)
    house.start("patient")
    house.until(lambda: (house.folder / "patient.log.1").exists())
    assert house.log("patient") == ""


def test_logs_of_processes_are_their_owners_alone(house: House) -> None:
    house.start("good")
    house.until(lambda: not house.supervisor.alive())
    assert (house.folder / "good.log").stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (("--policy", "random:\0"), "embedded null byte"),
        (("\ud800",), "surrogates not allowed"),
        (("x" * 2**22,), "Argument list too long"),
    ],
)
def test_what_no_process_can_be_given_is_told_and_ends_nothing(
    arguments: tuple[str, ...], why: str, tmp_path: Path
) -> None:
    house = House(spawn, tmp_path)
    with house.signals, house.supervisor:
        house.start("patient")
        house.start("good", *arguments)
        assert house.kinds("good") == ["unrecoverable"]
        assert f"good: cannot be started: {why}" in house.events[-1].text.replace("[Errno 7] ", "").replace(
            "'utf-8' codec can't encode character '\\ud800' in position 0: ", ""
        )
        assert house.supervisor.alive() == ["patient"]
        house.until(lambda: "ready" in house.log("patient"))
        house.start("good")
        house.until(lambda: house.supervisor.alive() == ["patient"])
        assert house.kinds("good") == ["unrecoverable", "started", "ended"]


def test_a_log_that_cannot_be_written_keeps_one_process_from_starting_and_no_other(house: House) -> None:
    house.start("patient")
    house.until(lambda: "ready" in house.log("patient"))
    folder = house.folder
    house.folder = folder / "missing"
    house.start("good")
    assert house.kinds("good") == ["unrecoverable"]
    assert "No such file or directory" in house.events[-1].text
    assert house.supervisor.last_log_lines("good") == []
    house.folder = folder
    assert house.supervisor.alive() == ["patient"]


def test_a_log_folder_that_is_gone_ends_no_supervisor(house: House) -> None:
    house.folder /= "logs"
    house.folder.mkdir()
    house.start("patient")
    house.until(lambda: "ready" in house.log("patient"))
    shutil.rmtree(house.folder)
    first = house.supervisor.pid("patient")
    assert first is not None
    os.kill(first, signal.SIGKILL)
    house.until(lambda: "gave_up" in house.kinds("patient"))
    assert "cannot be started: " in house.events[-1].text
