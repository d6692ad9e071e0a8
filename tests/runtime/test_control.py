"""The control socket: JSON lines over a Unix socket, whatever comes along it."""

from __future__ import annotations

import asyncio
import json
import socket
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest
from systems import system_of

from plcemu.base.errors import PlcemuError
from plcemu.runtime.commands import COMMANDS, CommandError, read_value
from plcemu.runtime.config import load_config
from plcemu.runtime.control import (
    CLIENTS,
    MESSAGE_BYTES,
    ControlError,
    ControlServer,
    ask,
    socket_path,
)
from plcemu.runtime.daemon import Daemon
from plcemu.runtime.notify import Notifier
from plcemu.runtime.retention import default_path


async def echo(request: dict[str, Any]) -> dict[str, Any]:
    if request.get("command") == "refuse":
        raise PlcemuError("not today")
    return {"got": request}


def served(path: Path, work: Callable[[], Awaitable[Any]]) -> Any:
    """Return what some work gives while a server listens."""
    async def main() -> Any:
        server = ControlServer(path, echo)
        await server.start()
        try:
            return await work()
        finally:
            await server.stop()
    return asyncio.run(main())


async def exchanged(path: Path, data: bytes) -> list[dict[str, Any]]:
    """Send bytes, close that direction, and return the answers."""
    reader, writer = await asyncio.open_unix_connection(str(path))
    writer.write(data)
    writer.write_eof()
    lines = (await reader.read()).splitlines()
    writer.close()
    return [json.loads(line) for line in lines]


def answers(path: Path, data: bytes) -> list[dict[str, Any]]:
    answered: list[dict[str, Any]] = served(path, lambda: exchanged(path, data))
    return answered


def test_requests_on_one_connection_are_answered_in_order(tmp_path: Path) -> None:
    got = answers(tmp_path / "s", b'{"command": "a"}\n{"command": "b"}\n')
    assert [a["got"]["command"] for a in got] == ["a", "b"] and all(a["ok"] for a in got)


@pytest.mark.parametrize("line", [b"nonsense\n", b"[1]\n", b"7\n", b"\xff\xfe\n", b"\n",
                                  b"[" * 5000 + b"\n"])
def test_what_is_no_request_is_refused_and_the_connection_goes_on(tmp_path: Path,
                                                                  line: bytes) -> None:
    first, second = answers(tmp_path / "s", line + b'{"command": "a"}\n')
    assert not first["ok"] and "JSON" in first["error"] and second["ok"]


def test_a_request_that_is_too_long_ends_the_connection(tmp_path: Path) -> None:
    (only,) = answers(tmp_path / "s", b"x" * (MESSAGE_BYTES + 10))
    assert not only["ok"] and str(MESSAGE_BYTES) in only["error"]


def test_a_refusal_tells_why(tmp_path: Path) -> None:
    assert answers(tmp_path / "s", b'{"command": "refuse"}\n') == [
        {"ok": False, "error": "not today"}]


def test_one_client_too_many_is_told_so(tmp_path: Path) -> None:
    async def crowd() -> dict[str, Any]:
        others = [await asyncio.open_unix_connection(str(tmp_path / "s")) for _ in range(CLIENTS)]
        (answer,) = await exchanged(tmp_path / "s", b"")
        for _, writer in others:
            writer.close()
        return answer
    assert "connected already" in served(tmp_path / "s", crowd)["error"]


def test_only_the_owner_may_connect_and_the_socket_goes_with_the_server(tmp_path: Path) -> None:
    async def mode() -> int:
        return (tmp_path / "d" / "s").stat().st_mode & 0o777
    assert served(tmp_path / "d" / "s", mode) == 0o600
    assert not (tmp_path / "d" / "s").exists()


def test_a_socket_that_a_dead_process_left_is_taken_over(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as dead:
        dead.bind(str(tmp_path / "s"))
    assert answers(tmp_path / "s", b'{"command": "a"}\n')[0]["ok"]


def test_a_living_socket_and_another_file_are_not(tmp_path: Path) -> None:
    async def second() -> None:
        with pytest.raises(ControlError, match="another process listens"):
            await ControlServer(tmp_path / "s", echo).start()
    served(tmp_path / "s", second)
    (tmp_path / "file").write_text("mine")
    with pytest.raises(ControlError, match="no socket"):
        asyncio.run(ControlServer(tmp_path / "file", echo).start())
    assert (tmp_path / "file").read_text() == "mine"


def test_nobody_there_is_said_with_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(ControlError, match="start one by `plcemu run`"):
        ask(tmp_path / "none", {"command": "status"})
    with pytest.raises(ControlError, match="longer than"):
        ask(tmp_path / ("x" * 120), {"command": "status"})


def test_each_configuration_has_its_own_socket_and_file(tmp_path: Path,
                                                        monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)
    paths = set()
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        config = system_of(tmp_path / name).config
        paths |= {socket_path(config), default_path(config.file_path)}
    assert len(paths) == 4 and all(p.is_relative_to(tmp_path / "plcemu") for p in paths)
    named = load_config(tmp_path / "a", ["control.socket=/run/x/s", "retain.file=here"])
    assert socket_path(named) == Path("/run/x/s")
    monkeypatch.setenv("STATE_DIRECTORY", "/var/lib/plcemu:/other")
    assert default_path(config.file_path).parent == Path("/var/lib/plcemu")


# ---------------------------------------------------------------- values


@pytest.mark.parametrize(("of", "text", "value"), [
    ("BOOL", "TRUE", True), ("BOOL", "0", 0), ("INT", "-1_000", -1000), ("WORD", "16#FF", 255),
    ("BYTE", "2#101", 5), ("REAL", "2.5e3", 2500.0), ("TIME", "1.5s", "1.5s"), ("TIME", "40", 40),
    ("TIME", "T#2s", "T#2s"), ("STRING[9]", " a b ", " a b "), ("DINT", 7, 7)])
def test_values_are_read_as_people_write_them(of: str, text: object, value: object) -> None:
    assert read_value(of, text) == value


@pytest.mark.parametrize(("of", "text"), [("INT", "x"), ("BOOL", "yes"), ("REAL", "1,5"),
                                          ("WORD", "16#G"), ("INT", "1.5"), ("WORD", "99#1")])
def test_what_is_no_value_of_the_type_is_refused(of: str, text: str) -> None:
    with pytest.raises(CommandError, match=of):
        read_value(of, text)


# ---------------------------------------------------------------- a daemon in virtual wait


def conversation(folder: Path, *requests: dict[str, Any],
                 text: str = "") -> list[dict[str, Any] | str]:
    """Return the answers of a daemon in this process to requests, one after another."""
    system = system_of(folder, f"modbus: {{enabled: false}}\ncycle: 1ms\n{text}")
    daemon = Daemon(system)
    from plcemu.runtime.commands import Commands

    async def main() -> list[dict[str, Any] | str]:
        running = asyncio.ensure_future(daemon.run())
        commands, given = Commands(daemon), []
        for request in requests:
            try:
                given.append(await commands.handle(request))
            except PlcemuError as refusal:
                given.append(str(refusal))
        daemon.stop("done")
        await running
        return given
    return asyncio.run(main())


def ask_for(command: str, *values: object, **options: object) -> dict[str, Any]:
    return {"command": command, **dict(zip(COMMANDS[command].arguments, values, strict=True)),
            **options}


def test_every_request_has_taken_effect_when_it_is_answered(tmp_path: Path) -> None:
    got = conversation(
        tmp_path, ask_for("set", "level", "5"), ask_for("get", "speed"),
        ask_for("force", "speed", 9), ask_for("get", "%QW1"), ask_for("unforce", "speed"),
        ask_for("get", "speed"), ask_for("stop"), ask_for("get", "speed"), ask_for("status"),
        ask_for("start"), ask_for("get", "speed"), ask_for("restart", mode="cold"),
        ask_for("get", "speed"), ask_for("get", "task.overruns"))
    values = [a["value"] for a in got if isinstance(a, dict) and "value" in a]
    assert values[:6] == [5, 9, 5, 0, 5, 5]
    status = got[8]
    assert isinstance(status, dict) and (status["state"], status["forces"]) == ("STOP", [])


def test_what_cannot_be_done_is_refused_with_a_reason(tmp_path: Path) -> None:
    got = conversation(
        tmp_path, {"command": "statu"}, {"command": "get"}, {"command": "get", "name": 7},
        ask_for("get", "levle"), ask_for("set", "level", "70000"), ask_for("force", "%QW9", "1"),
        ask_for("restart", mode="hot"), {"command": "stop", "now": True}, {}, ask_for("commit"),
        text="retain: {enabled: false}")
    assert all(isinstance(answer, str) for answer in got)
    for answer, part in zip(got, (
            "did you mean 'status'", "needs a name", "needs a name", "did you mean", "range of INT",
            "%QW9", "warm or cold", "takes no 'now'", "there is no command", "no retained"),
            strict=True):
        assert part in answer


def test_a_reload_takes_the_edited_program_and_a_wrong_one_leaves_the_old(tmp_path: Path) -> None:
    system = system_of(tmp_path, "modbus: {enabled: false}\ncycle: 1ms\n"
                       "control: {enabled: false}")
    daemon = Daemon(system)

    async def main() -> tuple[str, tuple[str, ...]]:
        running = asyncio.ensure_future(daemon.run())
        source = tmp_path / "main.il"
        text = source.read_text()
        source.write_text(text.replace("ST  pump", "ST  nix"))
        with pytest.raises(PlcemuError) as refused:
            await daemon.reload()
        source.write_text(text.replace("count : INT;", "count : INT; more : INT;"))
        report = await daemon.reload()
        daemon.stop("done")
        await running
        return str(refused.value), report.added
    why, added = asyncio.run(main())
    assert "nix" in why and added == ("MAIN.more",) and daemon.changes == 1
    assert "MAIN.more" in system.cycle.tags


# ---------------------------------------------------------------- the service manager


@pytest.mark.parametrize("address", ["path", "abstract"])
def test_the_service_manager_is_told_on_either_kind_of_socket(tmp_path: Path,
                                                              address: str) -> None:
    name = {"path": str(tmp_path / "notify"), "abstract": f"@plcemu-test-{tmp_path.name}"}[address]
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(name.replace("@", "\0", 1))
        notifier = Notifier({"NOTIFY_SOCKET": name, "WATCHDOG_USEC": "1000000"})
        notifier.tell(READY=1, STATUS="RUN")
        notifier.alive()
        notifier.alive()
        notifier.reloading()
        got = [manager.recv(500).decode() for _ in range(3)]
        notifier.close()
        manager.setblocking(False)
        with pytest.raises(BlockingIOError):
            manager.recv(500)
    assert got[:2] == ["READY=1\nSTATUS=RUN", "WATCHDOG=1"]
    assert got[2].startswith("RELOADING=1\nMONOTONIC_USEC=")
    assert notifier.watchdog_ns == 1_000_000_000


@pytest.mark.parametrize("environment", [
    {}, {"WATCHDOG_USEC": "5"}, {"NOTIFY_SOCKET": "/nowhere", "WATCHDOG_USEC": "x"},
    {"NOTIFY_SOCKET": "/nowhere", "WATCHDOG_USEC": "5000", "WATCHDOG_PID": "1"}])
def test_without_a_manager_or_a_watchdog_nothing_happens(environment: dict[str, str]) -> None:
    notifier = Notifier(environment)
    notifier.tell(READY=1)
    notifier.alive()
    assert notifier.watchdog_ns is None
    notifier.close()
