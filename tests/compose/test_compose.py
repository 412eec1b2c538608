"""``docker compose up`` by a real engine: from nothing to a price, more homes, killed containers, and the journal."""

from __future__ import annotations

import os
import re
import sqlite3
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
import yaml

from support.compose_stack import ROOT, ComposeStack
from support.docker_daemon import CERTIFICATES, OFFICIAL, NoDocker, base_image, compose_commands, docker_daemon
from zengrid.journal import Journal
from zengrid.journal.audit import audit
from zengrid.scenario import load

pytestmark = [pytest.mark.compose]
BUILT = os.environ.get("ZENGRID_TEST_IMAGE")
"""An image to test instead of building one."""
IMAGE = BUILT or "zengrid:test"
LARGEST_MB = 400
PROFILES = ("postgres", "router", "observability", "secure")
LEARN_IMAGE = "zengrid:test-learn"
WHEELS_PORT = 18473
SECURE = ("--env-file", "deploy/compose/secure.env")
SUN = """
import yaml
from zengrid.scenario import Days, dumps, load, loads

scenario = yaml.safe_load(dumps(load("paper")))
scenario["site"] = {"latitude": 36.75, "longitude": -119.77, "timezone": "America/Los_Angeles", "altitude_m": 94}
for home in scenario["homes"]:
    home["tilt_deg"] = 30
print(Days(loads(yaml.safe_dump(scenario))).day(100).pv_kw.max())
"""
"""The most that the paper's homes get out of a clear sky that must be computed. [kW]"""
INTRUDER = """
import sys
from pathlib import Path
from zengrid.bus.credentials import Credentials
from zengrid.bus.keys import KeyExpressions
from zengrid.bus.zenoh_session import open_client
from zengrid.wire.codec import JSON, encode
from zengrid.wire.queries import JoinRequest

keys = KeyExpressions("main")
with open_client("tls/clock:7447", credentials=Credentials(Path("/certs"), "p1"), timeout_s=60.0) as session:
    for key in (keys.join("p1"), keys.join("p2")):
        request = JoinRequest(agent="p2", role="prosumer", instance="0123456789abcdef")
        for answer in session.get(key, payload=encode(request), encoding=JSON, timeout=5.0):
            print(key, answer.err.payload.to_string())
"""
"""Has the certificate of p1, and asks to play p2: under its own key, and under the other's."""


@pytest.fixture(scope="module")
def docker() -> Iterator[dict[str, str]]:
    """The environment in which docker finds its daemon, and Compose the image."""
    try:
        with docker_daemon() as environment:
            if BUILT is None:
                build(environment, IMAGE)
            yield {**environment, "ZENGRID_IMAGE": IMAGE}
    except NoDocker as reason:
        pytest.skip(str(reason))


def build(environment: dict[str, str], tag: str, **arguments: str) -> None:
    """Build an image, in a way that old and new builders know."""
    base = base_image(environment)
    words = ["build", "--network", "host", "--build-arg", f"BASE={base}", "--tag", tag]
    for name, value in arguments.items():
        words += ["--build-arg", f"{name}={value}"]
    if CERTIFICATES.exists() and base != OFFICIAL:
        words += ["--build-arg", f"PIP_CERT={CERTIFICATES}"]
    ComposeStack([], {**environment, "DOCKER_BUILDKIT": "0"}).docker(*words, str(ROOT))


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
            stack = ComposeStack(command, docker)
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
    stack = ComposeStack([], docker)
    megabytes = int(stack.docker("image", "inspect", "--format", "{{.Size}}", IMAGE)) / 1e6
    sys.stdout.write(f"image: {megabytes:.0f} MB\n")
    assert megabytes < LARGEST_MB
    user = stack.docker("run", "--rm", "--network", "none", "--entrypoint", "id", IMAGE, "-u")
    assert user.strip() == "10001"


@pytest.fixture
def wheels() -> Iterator[str]:
    """An index for pip with torch without CUDA: the folder that pip is told of here, where a build can read it."""
    folder = Path(os.environ.get("PIP_FIND_LINKS", "nowhere"))
    if not any(folder.glob("torch-*+cpu-*.whl")):
        pytest.skip("needs a folder PIP_FIND_LINKS with torch without CUDA: PyPI's brings gigabytes of CUDA along")
    serve = partial(SimpleHTTPRequestHandler, directory=folder)
    # The same port each time, as long as it is free: another one would have everything built anew.
    try:
        server = ThreadingHTTPServer(("127.0.0.1", WHEELS_PORT), serve)
    except OSError:
        server = ThreadingHTTPServer(("127.0.0.1", 0), serve)
    with server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()


@pytest.mark.timeout(1800)
def test_the_large_image_trains_and_knows_the_sun(docker: dict[str, str], wheels: str) -> None:
    build(docker, LEARN_IMAGE, IMAGE="learn", PIP_FIND_LINKS=wheels)
    stack = ComposeStack([], docker)
    run = ("run", "--rm", "--network", "none", "--read-only", "--tmpfs", "/tmp:mode=1777", "--tmpfs", "/data:mode=1777")
    megabytes = int(stack.docker("image", "inspect", "--format", "{{.Size}}", LEARN_IMAGE)) / 1e6
    sys.stdout.write(f"image for learning: {megabytes:.0f} MB\n")
    stack.docker(*run, LEARN_IMAGE, "train", "--set", "steps=200", "--quiet", "--out", "/tmp/policies")
    sunny = stack.docker(*run, "--entrypoint", "python", LEARN_IMAGE, "-c", SUN)
    assert float(sunny) > 1.0


def test_a_market_of_containers_outlives_each_of_them(
    docker: dict[str, str], compose: list[str], tmp_path: Path
) -> None:
    with ComposeStack(compose, docker) as stack:
        began = time.monotonic()
        stack.run("up", "--detach", "--no-build")
        price = stack.wait(lambda: stack.get("/v1/price"), "a price by HTTP")
        sys.stdout.write(f"from nothing to a price: {time.monotonic() - began:.1f} s\n")
        assert price["buy_price"] in load("paper").buy_prices
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


def test_with_certificates_nobody_else_gets_in(docker: dict[str, str], compose: list[str], tmp_path: Path) -> None:
    with ComposeStack([*compose, *SECURE], docker) as stack:
        stack.run("up", "--detach", "--no-build")
        stack.wait(lambda: stack.get("/v1/price"), "a price by HTTP")
        assert set(stack.wait_for_agents(3)) == {"p1", "p2", "p3"}
        for service in ("p1", "grid", "gateway"):
            (container,) = stack.containers(service)
            held = stack.docker("exec", container, "ls", "/certs").split()
            assert held == sorted(["ca.pem", f"{service}.key", f"{service}.pem"])

        # In the market's network, but without a certificate; the authority itself is no secret.
        home = ("prosumer", "--id", "p4", "--pv", "3", "--battery", "5", "--timeout", "10")
        assert "nobody listens there" in outsider(stack, *home, "--connect", "tcp/clock:7447")
        authority = ("--connect", "tls/clock:7447", "--certs", "/certs")
        assert "p4.pem: no such file" in outsider(stack, *home, *authority, certs="p1")

        # With another's: whoever it is of plays on, and each attempt is counted.
        second = ("prosumer", "--id", "p1", "--timeout", "10", *authority)
        assert "another process plays it" in outsider(stack, *second, certs="p1")
        stack.wait(lambda: refusals(stack, "join_taken") and refusals(stack, "second_session"), "refusals of a second")
        answers = outsider(stack, "-c", INTRUDER, certs="p1", program="python")
        assert "not_yours" in answers
        assert "clock/join/p2" not in answers, "what is asked under another's key is answered by nobody"
        stack.wait(lambda: refusals(stack, "join_not_yours") == 1, "a refusal of who asks in another's name")
        assert set(stack.wait_for_agents(3)) == {"p1", "p2", "p3"}
        stack.wait_for_slots(2)

        # A certificate more, as the guide says.
        stack.run("run", "--rm", "certs", "--ids", "school")
        stack.run("restart", "clock", "spawner")
        (spawner,) = stack.containers("spawner")
        assert "school.key" in stack.docker("exec", spawner, "ls", "/certs")
        stack.wait_for_slots(2)
        assert set(stack.wait_for_agents(3)) == {"p1", "p2", "p3"}
        stack.run("stop", "--timeout", "20")
        check_journal(stack, tmp_path)


def outsider(stack: ComposeStack, *words: str, certs: str | None = None, program: str = "zengrid") -> str:
    """Run a container in the market's network, with somebody's certificates or none; returns what it said."""
    project = stack.environment["COMPOSE_PROJECT_NAME"]
    volume = [] if certs is None else ["--volume", f"{project}_certs-{certs}:/certs:ro"]
    command = ["docker", "run", "--rm", "--network", f"{project}_market", *volume, "--entrypoint", program, IMAGE]
    done = subprocess.run(
        [*command, *words], env=stack.environment, capture_output=True, text=True, check=False, timeout=120
    )
    return done.stdout + done.stderr


def refusals(stack: ComposeStack, cause: str) -> float:
    """How many messages the market has refused for this cause."""
    with urllib.request.urlopen(f"http://127.0.0.1:{stack.port}/metrics", timeout=10) as answer:
        text = answer.read().decode()
    found = re.search(rf'^zengrid_refused_actions_total{{cause="{cause}"}} (.*)$', text, flags=re.MULTILINE)
    return float(found[1]) if found else 0.0


def all_of(stack: ComposeStack) -> list[str]:
    """Ids of all containers of the stack, also of those that have ended."""
    project = stack.environment["COMPOSE_PROJECT_NAME"]
    return stack.docker("ps", "-aq", "--filter", f"label=com.docker.compose.project={project}").split()


def check_access(stack: ComposeStack) -> None:
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


def check_journal(stack: ComposeStack, folder: Path) -> None:
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
