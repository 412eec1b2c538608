"""A Docker daemon for tests: the one that runs here, or a new one in its own folder."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

CACHE = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "zengrid-tests"
OFFICIAL = "python:3.11-slim"
BASE_IMAGE = "zengrid-test-base:bookworm"
CERTIFICATES = Path("/etc/ssl/certs/ca-certificates.crt")


class NoDocker(Exception):  # noqa: N818 - a reason to skip
    """Why containers cannot be tested here."""


@contextmanager
def docker_daemon() -> Iterator[dict[str, str]]:
    """The environment in which ``docker`` finds a daemon; one that was started for it ends with it."""
    if shutil.which("docker") is None:
        raise NoDocker("there is no docker command")
    if _answers({}):
        yield {}
        return
    if os.geteuid() != 0 or shutil.which("dockerd") is None:
        raise NoDocker("no Docker daemon answers, and one can be started by root with dockerd alone")
    CACHE.mkdir(parents=True, exist_ok=True)
    at = f"unix://{CACHE}/docker.sock"
    pidfile = CACHE / "docker.pid"
    pidfile.unlink(missing_ok=True)  # of a daemon that was killed: nobody answers there, see above
    command = [
        "dockerd", "--host", at, "--data-root", str(CACHE / "docker"), "--exec-root", str(CACHE / "exec"),
        "--pidfile", str(pidfile), "--iptables=false", "--ip6tables=false", "--ip-masq=false", "--ip-forward=false",
    ]  # fmt: skip
    # The machine's firewall stays as it is: ports on loopback are published by a proxy, images build in its network.
    with (CACHE / "dockerd.log").open("w") as log, subprocess.Popen(command, stdout=log, stderr=log) as daemon:
        try:
            until = time.monotonic() + 60
            while not _answers({"DOCKER_HOST": at}):
                if daemon.poll() is not None or time.monotonic() > until:
                    raise NoDocker(f"dockerd does not run here: {_last_line(CACHE / 'dockerd.log')}")
                time.sleep(0.2)
            yield {"DOCKER_HOST": at}
        finally:
            daemon.terminate()
            daemon.wait(60)


def _answers(environment: dict[str, str]) -> bool:
    asked = subprocess.run(
        ["docker", "info", "--format", "{{.ServerVersion}}"],
        env={**os.environ, **environment},
        capture_output=True,
        check=False,
    )
    return asked.returncode == 0


def _last_line(log: Path) -> str:
    lines = log.read_text(errors="replace").splitlines()
    return lines[-1] if lines else "it said nothing"


def compose_commands() -> list[list[str]]:
    """Every Compose that is there: the plugin, and docker-compose 1.29."""
    plugin = subprocess.run(["docker", "compose", "version"], capture_output=True, check=False).returncode == 0
    found = [["docker", "compose"]] if plugin else []
    return found + ([["docker-compose"]] if shutil.which("docker-compose") else [])


def base_image(environment: dict[str, str]) -> str:
    """An image to build on: ``python:3.11-slim``, or where none can be fetched, Debian with Python, made here once.

    The latter trusts whom this machine trusts.
    """
    docker = {**os.environ, **environment}
    if (
        subprocess.run(["docker", "pull", "--quiet", OFFICIAL], env=docker, capture_output=True, check=False).returncode
        == 0
    ):
        return OFFICIAL
    known = subprocess.run(["docker", "image", "inspect", BASE_IMAGE], env=docker, capture_output=True, check=False)
    if known.returncode == 0:
        return BASE_IMAGE
    if shutil.which("debootstrap") is None:
        raise NoDocker("no base image: there is no debootstrap to make one")
    folder = CACHE / "base"
    shutil.rmtree(folder, ignore_errors=True)
    include = "python3,python3-venv,ca-certificates,binutils"
    command = ["debootstrap", "--variant=minbase", f"--include={include}", "bookworm", str(folder)]
    made = subprocess.run(command, capture_output=True, text=True, check=False)
    if made.returncode:
        raise NoDocker(f"no base image: debootstrap failed: {made.stdout[-500:]}")
    if CERTIFICATES.exists():
        shutil.copy(CERTIFICATES, folder / CERTIFICATES.relative_to("/"))
    left_out = ("usr/share/doc", "usr/share/man", "usr/share/locale", "var/cache/apt", "var/lib/apt/lists")
    pack = ["tar", "-C", str(folder), *(f"--exclude=./{path}/*" for path in left_out), "-c", "."]
    with subprocess.Popen(pack, stdout=subprocess.PIPE) as packing:
        subprocess.run(["docker", "import", "-", BASE_IMAGE], env=docker, stdin=packing.stdout, check=True)
    shutil.rmtree(folder)
    return BASE_IMAGE
