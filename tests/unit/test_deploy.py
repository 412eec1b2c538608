"""What is shipped for operators fits together: manifests follow their schemas, the board asks for real metrics."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
import yaml

from support.public_names import series_names
from zengrid.bus.access_list import AccessList
from zengrid.bus.certificates import hosts_of, read_certificate
from zengrid.bus.credentials import Credentials
from zengrid_cli.commands.health_command import connected

ROOT = Path(__file__).parents[2]
DEPLOY = ROOT / "deploy"
MANIFESTS = [part for part in yaml.safe_load_all((DEPLOY / "kubernetes" / "zengrid.yaml").read_text()) if part]
PODS = [part["spec"]["template"]["spec"] for part in MANIFESTS if part["kind"] in ("StatefulSet", "Deployment")]


@pytest.mark.parametrize("manifest", MANIFESTS, ids=lambda part: f"{part['kind']}-{part['metadata']['name']}")
def test_manifests_follow_the_schemas_of_kubernetes(manifest: dict[str, Any]) -> None:
    kubernetes_validate.validate(manifest, "1.33", strict=True)


def test_the_schemas_find_a_mistake() -> None:
    wrong = {**MANIFESTS[0], "metadata": {"name": "zengrid", "lables": {}}}
    with pytest.raises(kubernetes_validate.ValidationError):
        kubernetes_validate.validate(wrong, "1.33", strict=True)


def test_pods_are_locked_and_their_options_are_those_of_the_commands() -> None:
    settings = next(part["data"] for part in MANIFESTS if part["kind"] == "ConfigMap")
    assert len(PODS) == 5
    for pod in PODS:
        assert pod["securityContext"]["runAsNonRoot"]
        (container,) = pod["containers"]
        assert container["securityContext"]["readOnlyRootFilesystem"]
        assert container["securityContext"]["capabilities"] == {"drop": ["ALL"]}
        assert {"readinessProbe", "startupProbe"} & set(container)
        assert container["envFrom"] == [{"configMapRef": {"name": "zengrid"}}]
        parse([re.sub(r"\$\((\w+)\)", lambda name: settings[name[1]], word) for word in container["args"]])


def test_commands_of_the_compose_file_are_understood() -> None:
    services = yaml.safe_load((ROOT / "docker-compose.yml").read_text())["services"]
    ours = {name: service for name, service in services.items() if "zengrid" in str(service["image"])}
    assert set(ours) == {"clock", "grid", "prosumer", "spawner", "gateway"}
    for service in ours.values():
        parse(re.sub(r"\$\{\w+:-([^}]*)\}", r"\1", service["command"]).split())
        assert service["read_only"]
        assert service["healthcheck"]


def parse(words: list[str]) -> None:
    """Fails where the command of that name does not take these options."""
    from zengrid_agent.__main__ import parser as agent
    from zengrid_clock.__main__ import parser as clock
    from zengrid_gateway.__main__ import parser as gateway
    from zengrid_spawner.__main__ import parser as spawner

    if words[0] in ("grid", "prosumer"):
        agent().parse_args(words)
    else:
        {"clock": clock, "gateway": gateway, "spawner": spawner}[words[0]]().parse_args(words[1:])


def test_the_board_and_the_alerts_ask_for_metrics_that_exist() -> None:
    board = json.loads((DEPLOY / "grafana" / "zengrid.json").read_text())
    alerts = yaml.safe_load((DEPLOY / "prometheus" / "alerts.yml").read_text())
    asked = [target["expr"] for panel in board["panels"] for target in panel["targets"]]
    asked += [rule["expr"] for group in alerts["groups"] for rule in group["rules"]]
    names = {name for text in asked for name in re.findall(r"\bzengrid_\w+", text)}
    assert len(names) > 15
    assert names - series_names() == set()


def test_prometheus_and_grafana_find_each_other() -> None:
    services = yaml.safe_load((ROOT / "docker-compose.yml").read_text())["services"]
    scrape = yaml.safe_load((DEPLOY / "prometheus" / "prometheus.yml").read_text())["scrape_configs"][0]
    host, port = scrape["static_configs"][0]["targets"][0].split(":")
    assert services[host]["ports"][0].endswith(f":{port}")
    source = yaml.safe_load((DEPLOY / "grafana" / "provisioning" / "datasources" / "prometheus.yml").read_text())
    assert source["datasources"][0]["url"].removeprefix("http://").partition(":")[0] in services
    for name in ("prometheus", "grafana"):
        for volume in services[name]["volumes"]:
            path = volume.partition(":")[0]
            assert not path.startswith("./") or (ROOT / path).exists(), path


def test_health_knows_a_connection_from_a_listener() -> None:
    listens = "0: 0100007F:1D17 00000000:0000 0A 00000000:00000000"
    holds = "1: 0200140A:D2F4 0300140A:1D17 01 00000000:00000000"
    assert not connected([listens], 7447)
    assert connected([listens, holds], 7447)
    assert not connected([holds], 7448)


def test_the_image_installs_all_that_services_need() -> None:
    """What the market's image leaves out is loaded by no service: its builder imports them all, see warm.py."""
    warm = (DEPLOY / "docker" / "warm.py").read_text()
    for service in ("clock", "agent", "gateway", "spawner"):
        assert f'"zengrid_{service}.' in warm


def test_with_certificates_each_service_sees_its_own_alone(tmp_path: Path) -> None:
    """The script that hands certificates out, really run: what each volume holds is enough, and no more."""
    secure = yaml.safe_load((DEPLOY / "compose" / "secure.yml").read_text())
    base = yaml.safe_load((ROOT / "docker-compose.yml").read_text())
    assert secure["x-zengrid"] == base["x-zengrid"]
    services = secure["services"]
    assert set(services) == {"certs", "clock", "grid", "prosumer", "p1", "p2", "p3", "spawner", "gateway"}
    assert services["prosumer"] == {"scale": 0}

    hand_out(tmp_path)
    first = {path: path.read_bytes() for path in tmp_path.rglob("*.key")}
    hand_out(tmp_path, "--ids", "school")
    assert {path: path.read_bytes() for path in first} == first, "a second run has replaced keys"
    handed = {volume: tmp_path / Path(path).name for volume, path in map(mount, services["certs"]["volumes"][1:])}
    assert set(handed) == set(secure["volumes"])
    assert set(handed.values()) == set(tmp_path.iterdir())

    keys: dict[str, set[str]] = {}
    for name in set(services) - {"certs", "prosumer"}:
        service = services[name]
        assert service["environment"]["ZENGRID_CERTS"] == "/certs"
        assert service["depends_on"]["certs"] == {"condition": "service_completed_successfully"}
        ((volume, path),) = map(mount, service["volumes"])
        assert path == "/certs"
        folder = handed[volume]
        assert all(file.stat().st_mode & 0o777 == 0o600 for file in folder.iterdir())
        keys[name] = {path.stem for path in folder.glob("*.key")}
        for key in keys[name]:
            Credentials(folder, key)
        command = service.get("command")
        if command is not None:
            words = re.sub(r"\$\{\w+:-([^}]*)\}", r"\1", command).split()
            parse(words)
            assert words[:3] == ["prosumer", "--id", name]
    agents = AccessList.load(tmp_path / "clock").agents
    assert len(agents) == 25
    assert keys.pop("clock") == {"clock", "operator"}
    assert keys.pop("spawner") == {"spawner", *agents} - {"grid", "p1", "p2", "p3"}
    assert keys == {name: {name} for name in ("gateway", "grid", "p1", "p2", "p3")}
    assert "clock" in hosts_of(read_certificate(tmp_path / "clock" / "clock.pem"))


def hand_out(folder: Path, *words: str) -> None:
    """Run the script as the container does, in another folder and for whoever runs the tests."""
    environment = {
        **os.environ,
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
        "ZENGRID_CERTS_OUT": str(folder),
        "ZENGRID_CERTS_OWNER": f"{os.getuid()}:{os.getgid()}",
    }
    subprocess.run(["sh", str(DEPLOY / "compose" / "certs.sh"), *words], env=environment, check=True)


def mount(text: str) -> tuple[str, str]:
    """A volume and where it is, from Compose's short form."""
    volume, path = text.split(":")[:2]
    return volume, path


@pytest.mark.skipif(shutil.which("docker-compose") is None, reason="there is no docker-compose")
def test_compose_reads_the_file_with_certificates() -> None:
    command = ["docker-compose", "--env-file", "deploy/compose/secure.env", "config"]
    printed = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    services = yaml.safe_load(printed)["services"]
    assert services["prosumer"]["scale"] == 0
    assert services["clock"]["environment"] == {
        "ZENGRID_RUN": "main",
        "ZENGRID_CONNECT": "tcp/127.0.0.1:7447",
        "ZENGRID_CERTS": "/certs",
        "ZENGRID_LOG": "text",
        "ZENGRID_LOG_LEVEL": "warning",
    }
    assert set(services["p2"]["depends_on"]) == {"certs", "clock"}
    assert {"tokens:/tokens:rw", "certs-gateway:/certs:ro"} <= set(services["gateway"]["volumes"])
