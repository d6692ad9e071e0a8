"""The daemon as a service: signals, the service manager, retained variables, control."""

from __future__ import annotations

import json
import signal
import socket
from pathlib import Path
from typing import Any

import pytest
from processes import PATIENCE_S, Command, modbus_client, until
from systems import write_config

from plcemu.io.retain import RetainFile
from plcemu.runtime.control import ask

pytestmark = pytest.mark.acceptance

PROGRAM = """PROGRAM MAIN
VAR RETAIN n : UDINT; END_VAR
VAR out AT %QW0 : UINT; gain AT %MW0 : UINT; END_VAR
  n := n + gain; out := UDINT_TO_UINT(n);
END_PROGRAM
"""
CONFIG = ("program: main.il\ncycle: 10ms\nmodbus: {port: 0}\nsafe_outputs: {out: 7}\n"
          "retain: {file: kept, interval: 10ms}\ncontrol: {socket: s}\n")


def daemon(folder: Path, *arguments: object, **environment: str) -> Command:
    if not (folder / "config.yaml").exists():
        write_config(folder, CONFIG, PROGRAM)
    return Command("run", folder, "--json", *arguments, **environment)


def told(folder: Path, command: str, **values: object) -> dict[str, Any]:
    return ask(folder / "s", {"command": command, **values})


def n_in(folder: Path) -> int:
    value: int = told(folder, "get", name="n")["value"]
    return value


def test_a_service_lives_is_changed_and_ends_in_order(tmp_path: Path) -> None:
    """One daemon through its life, with a manager that listens and a client that stays on."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.settimeout(PATIENCE_S)
        told: list[str] = []

        def hear(word: str) -> None:
            while not told or word not in told[-1]:
                told.append(manager.recv(1000).decode())

        with daemon(tmp_path, "--log-format", "json", NOTIFY_SOCKET=str(tmp_path / "notify"),
                    WATCHDOG_USEC="400000") as plc, modbus_client(_port(plc)) as client:
            hear("READY=1")
            hear("WATCHDOG=1")
            client.write_register(1024, 1)
            until(lambda: client.read_holding_registers(0).registers[0] > 20, "the program counts")
            text = (tmp_path / "main.il").read_text()
            (tmp_path / "main.il").write_text(text.replace("n + gain", "n + nix"))
            plc.send(signal.SIGHUP)
            plc.wait_for("reload refused")
            (tmp_path / "main.il").write_text(text.replace("n + gain", "n + gain * 2")
                                              .replace("VAR out", "VAR pad : LINT; out"))
            plc.send(signal.SIGHUP)
            hear("RELOADING=1")
            plc.wait_for("reloaded: 3 kept, 1 added")
            before = client.read_holding_registers(0).registers[0]
            assert before > 20, "the connection and the value live on"
            plc.send(signal.SIGTERM)
            hear("STOPPING=1")
            until(lambda: client.read_holding_registers(0).registers[0] == 7, "safe outputs")
            assert plc.code() == 0
    lines = [json.loads(line) for line in plc.log if line.startswith("{")]
    assert {"time", "level", "logger", "message"} <= set(lines[0])
    assert "retained variables are kept" in plc.text
    commit = RetainFile(tmp_path / "kept").read().commit
    assert commit is not None and int.from_bytes(commit.data, "little") >= before


def _port(plc: Command) -> int:
    return int(plc.wait_for(r"listening on 127.0.0.1:(\d+)")[1])


def test_control_and_starts_warm_and_cold(tmp_path: Path) -> None:
    with daemon(tmp_path) as plc, modbus_client(plc.port) as client:
        client.write_register(1024, 1)
        until(lambda: n_in(tmp_path) > 5, "the program counts")
        assert told(tmp_path, "commit")["commits"] >= 1
        with Command("control", tmp_path, "set", "n", "-1", "--json") as command:
            code, refused = command.result()
        assert code == 1 and "range of UDINT" in refused["error"]
        with Command("control", tmp_path, "stop", "--json") as command:
            assert command.result() == (0, {"ok": True})
        assert client.read_holding_registers(0).registers[0] == 7
        kept = n_in(tmp_path)
        plc.kill()
    with Command("control", tmp_path, "status") as nobody:
        assert nobody.code() == 2 and "start one by `plcemu run`" in nobody.text
    with daemon(tmp_path) as plc:
        plc.wait_for(r"warm start(.*\n)*.*control socket")
        assert n_in(tmp_path) == kept
        plc.stop()
    with daemon(tmp_path, "--cold") as plc:
        plc.wait_for(r"cold start(.*\n)*.*control socket")
        assert n_in(tmp_path) == 0
        plc.stop()


def test_a_place_that_cannot_be_written_does_not_stop_the_plc(tmp_path: Path) -> None:
    (tmp_path / "blocked").write_text("a file where a folder is needed")
    with daemon(tmp_path, "--set", f"retain.file={tmp_path / 'blocked' / 'kept'}") as plc, \
            modbus_client(plc.port) as client:
        client.write_register(1024, 1)
        plc.wait_for("the PLC goes on")
        assert told(tmp_path, "get", name="retain.failed")["value"] is True
        assert told(tmp_path, "status")["state"] == "RUN"
        plc.stop()
    assert "Traceback" not in plc.text
