"""The example unit and container file: their options exist, and their keys are known."""

from __future__ import annotations

import configparser
import json
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

from plcemu.cli.main import make_parser
from plcemu.runtime.config import Config, load_config

DEPLOY = Path(__file__).parents[2] / "docs" / "deploy"
ROOT = DEPLOY.parents[1]

KNOWN = {
    "Unit": {"Description", "After"},
    "Service": {"Type", "ExecStart", "User", "Group", "WatchdogSec", "Restart", "RestartSec",
                "TimeoutStopSec", "StateDirectory", "RuntimeDirectory", "RuntimeDirectoryMode",
                "LimitRTPRIO", "LimitMEMLOCK", "NoNewPrivileges", "ProtectSystem", "ProtectHome",
                "PrivateTmp", "RestrictAddressFamilies"},
    "Install": {"WantedBy"}}
"""Keys of systemd.unit(5), systemd.service(5), systemd.exec(5) that the unit may use."""


def unit() -> configparser.ConfigParser:
    parser = configparser.ConfigParser(interpolation=None, delimiters=("=",))
    parser.optionxform = str  # type: ignore[assignment]
    parser.read(DEPLOY / "plcemu.service")
    return parser


def container() -> dict[str, list[str]]:
    """The instructions of the container file by name."""
    text = re.sub(r"\\\n", " ", (DEPLOY / "Containerfile").read_text())
    found: dict[str, list[str]] = {}
    for line in text.splitlines():
        name, _, rest = line.partition(" ")
        found.setdefault(name, []).append(rest)
    return found


def test_the_unit_has_only_keys_that_systemd_knows() -> None:
    parsed = unit()
    assert {name: set(parsed[name]) - KNOWN[name] for name in parsed.sections()} == {
        "Unit": set(), "Service": set(), "Install": set()}
    assert parsed["Service"]["Type"] == "notify-reload"


def test_the_units_command_line_is_one(tmp_path: Path) -> None:
    program, *arguments = shlex.split(unit()["Service"]["ExecStart"])
    parsed = make_parser().parse_args(arguments)
    assert (Path(program).name, parsed.command, parsed.config) == ("plcemu", "run", "/etc/plcemu")
    config = load_config(ROOT / "il_programs" / "batch_plant", parsed.overrides)
    assert config.control.socket == "/run/plcemu/control.sock"


def test_the_containers_command_lines_are_ones() -> None:
    instructions = container()
    assert json.loads(instructions["ENTRYPOINT"][0]) == ["plcemu"]
    run = make_parser().parse_args(json.loads(instructions["CMD"][0]))
    assert load_config(ROOT / "il_programs" / "batch_plant", run.overrides).modbus.host == "0.0.0.0"
    health = json.loads(instructions["HEALTHCHECK"][0].removeprefix("CMD "))
    assert make_parser().parse_args(health[1:]).command == "control"
    assert instructions["EXPOSE"] == [str(Config.model_fields["modbus"].default.port)]


def test_what_the_container_file_copies_is_there() -> None:
    copied = re.findall(r"/src/(\S+)", " ".join(container()["RUN"]))
    assert copied and all((ROOT / name).exists() for name in copied)


@pytest.mark.parametrize("tool", ["systemd-analyze"])
def test_systemd_itself_finds_nothing_wrong_where_it_is_there(tmp_path: Path, tool: str) -> None:
    copy = tmp_path / "plcemu.service"
    copy.write_text((DEPLOY / "plcemu.service").read_text().replace(
        "/opt/plcemu/bin/plcemu", shutil.which("true") or "/bin/true"))
    found = shutil.which(tool) or shutil.which("true") or "true"
    done = subprocess.run([found, "verify", copy], capture_output=True, text=True, check=False)
    assert not [line for line in done.stderr.splitlines() if "Unknown" in line]
