"""``docker compose up`` by a real engine: from nothing to a price, more homes, killed containers, and the journal."""

from __future__ import annotations

import os
import sqlite3
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from support.engines import CERTIFICATES, OFFICIAL, NoEngine, base_image, compose_commands, engine
from support.stacks import ROOT, Stack
from zengrid.journal import Journal
from zengrid.journal.audit import audit

pytestmark = [pytest.mark.compose]
BUILT = os.environ.get("ZENGRID_TEST_IMAGE")
"""An image to test instead of building one."""
IMAGE = BUILT or "zengrid:test"
LARGEST_MB = 400
PROFILES = ("postgres", "router", "observability", "secure")


@pytest.fixture(scope="module")
def docker() -> Iterator[dict[str, str]]:
    """The environment in which docker finds its daemon, and Compose the image."""
    try:
        with engine() as environment:
            if BUILT is None:
                build(environment)
            yield {**environment, "ZENGRID_IMAGE": IMAGE}
    except NoEngine as reason:
        pytest.skip(str(reason))


def build(environment: dict[str, str]) -> None:
    """Build the image, in a way that old and new builders know."""
    base = base_image(environment)
    words = ["build", "--network", "host", "--build-arg", f"BASE={base}", "--tag", IMAGE]
    if CERTIFICATES.exists() and base != OFFICIAL:
        words += ["--build-arg", f"PIP_CERT={CERTIFICATES}"]
    Stack([], {**environment, "DOCKER_BUILDKIT": "0"}).docker(*words, str(ROOT))


@pytest.fixture(scope="module")
def compose(docker: dict[str, str]) -> list[str]:
    commands = compose_commands()
    if not commands:
        pytest.skip("there is neither the docker compose plugin nor docker-compose")
    return commands[0]


def test_every_compose_takes_the_file_with_each_profile(docker: dict[str, str], compose: list[str]) -> None:
    # Images of PostgreSQL, Zenoh, Prometheus and Grafana may be out of reach: these parts are read, not run.
    assert compose
    for command in compose_commands():
        for profile in (None, *PROFILES):
            settings = ["--env-file", f"deploy/compose/{profile}.env"] if profile else []
            stack = Stack(command, docker)
            config = yaml.safe_load(stack.run(*settings, "config"))
            services = config["services"]
            if profile == "postgres":
                assert "postgresql://zengrid:zengrid@postgres/zengrid" in str(services["clock"]["command"])
            elif profile == "router":
                assert services["grid"]["environment"]["ZENGRID_CONNECT"] == "tcp/router:7447"
                assert services["clock"]["environment"]["ZENGRID_CONNECT"] == "tcp/127.0.0.1:7447"
            elif profile == "secure":
                assert services["gateway"]["environment"]["ZENGRID_CERTS"] == "/certs"
                assert set(services["p1"]["depends_on"]) == {"certs", "clock"}
            assert set(services) >= {"clock", "grid", "prosumer", "spawner", "gateway"}


def test_the_image_is_small_and_nobody_in_it_is_root(docker: dict[str, str]) -> None:
    stack = Stack([], docker)
    megabytes = int(stack.docker("image", "inspect", "--format", "{{.Size}}", IMAGE)) / 1e6
    sys.stdout.write(f"image: {megabytes:.0f} MB\n")
    assert megabytes < LARGEST_MB
    user = stack.docker("run", "--rm", "--network", "none", "--entrypoint", "id", IMAGE, "-u")
    assert user.strip() == "10001"


def test_a_market_of_containers_outlives_each_of_them(
    docker: dict[str, str], compose: list[str], tmp_path: Path
) -> None:
    with Stack(compose, docker) as stack:
        began = time.monotonic()
        stack.run("up", "--detach", "--no-build")
        price = stack.wait(lambda: stack.get("/v1/price"), "a price by HTTP")
        sys.stdout.write(f"from nothing to a price: {time.monotonic() - began:.1f} s\n")
        assert price["buy_price"] == 0.05
        assert set(stack.wait_for_agents(3)) == {"p1", "p2", "p3"}

        # Two more containers bring two more homes, named after themselves.
        stack.run("up", "--detach", "--no-build", "--scale", "prosumer=5")
        homes = stack.wait_for_agents(5)
        own = {f"home-{container[:12]}" for container in stack.containers("prosumer")}
        assert len(set(homes) - {"p1", "p2", "p3"}) == 2
        assert set(homes) - {"p1", "p2", "p3"} < own

        # Whoever dies is started again, and is who it was; the market goes on meanwhile.
        for service in ("prosumer", "grid", "gateway", "spawner", "clock"):
            for container in stack.containers(service)[-1:]:
                stack.kill(container)
            stack.wait_for_slots(2)
            assert set(stack.wait_for_agents(5)) == set(homes), service

        check_access(stack)
        stack.run("stop", "--timeout", "20")
        states = [stack.docker("inspect", "--format", "{{.State.ExitCode}}", one).strip() for one in all_of(stack)]
        assert set(states) == {"0"}, states
        check_journal(stack, tmp_path)


def all_of(stack: Stack) -> list[str]:
    """Ids of all containers of the stack, also of those that have ended."""
    project = stack.environment["COMPOSE_PROJECT_NAME"]
    return stack.docker("ps", "-aq", "--filter", f"label=com.docker.compose.project={project}").split()


def check_access(stack: Stack) -> None:
    """Reading is free; steering needs the token that the gateway's log has shown once."""
    logs = stack.run("logs", "gateway")
    token = next(word for word in logs.split() if word.startswith("zengrid_operate_"))
    url = f"http://127.0.0.1:{stack.port}/v1/control"
    for headers, wanted in (({}, 401), ({"Authorization": f"Bearer {token}"}, 200)):
        asked = urllib.request.Request(
            url, b'{"command": "resume"}', {"Content-Type": "application/json", **headers}, method="POST"
        )
        try:
            with urllib.request.urlopen(asked, timeout=20) as answer:
                got = answer.status
        except urllib.error.HTTPError as error:
            got = error.code
        assert got == wanted


def check_journal(stack: Stack, folder: Path) -> None:
    """All that was settled is in the journal once, and balances: one run, although its clock was killed."""
    clock = next(one for one in all_of(stack) if "clock" in stack.docker("inspect", "--format", "{{.Name}}", one))
    copied = subprocess.run(
        ["docker", "cp", f"{clock}:/data/.", str(folder)], env=stack.environment, capture_output=True, check=False
    )
    assert copied.returncode == 0, copied.stderr
    with Journal.open(str(folder / "zengrid.db"), read_only=True) as journal:
        assert len(journal.runs()) == 1
        run = journal.run()
        assert run.count() > 10
        assert audit(run) == []
    with sqlite3.connect(folder / "zengrid.db") as database:
        assert database.execute("PRAGMA integrity_check").fetchone() == ("ok",)
