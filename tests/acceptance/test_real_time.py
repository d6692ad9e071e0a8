"""What needs the real clock, or a terminal."""

from __future__ import annotations

import asyncio
import contextlib
import os
import pty
import re
import signal
import subprocess
import sys
import time
from fractions import Fraction
from pathlib import Path

import pytest
from processes import Command, until
from systems import BATCH, MS, S, write_config

from plcemu.runtime.clock import RealClock

pytestmark = pytest.mark.acceptance


def test_the_clock_wakes_at_its_deadlines_and_never_before() -> None:
    async def scenario() -> list[int]:
        with RealClock() as clock:
            late = []
            for n in range(1, 51):
                await clock.sleep_until_ns(n * 5 * MS)
                late.append(clock.now_ns() - n * 5 * MS)
            return late
    late = asyncio.run(scenario())
    assert min(late) >= 0
    assert sorted(late)[25] < 3 * MS


def test_a_deadline_in_the_past_gives_others_a_turn() -> None:
    async def scenario() -> list[str]:
        order: list[str] = []

        async def other() -> None:
            order.append("other")
        with RealClock() as clock:
            waiting = asyncio.ensure_future(other())
            await clock.sleep_until_ns(0)
            order.append("clock")
            await waiting
        return order
    assert asyncio.run(scenario()) == ["other", "clock"]


def test_a_scaled_clock_runs_faster_than_the_wall() -> None:
    async def scenario() -> tuple[int, float]:
        begin = time.monotonic()
        with RealClock(Fraction(100)) as clock:
            await clock.sleep_until_ns(10 * S)
            return clock.now_ns(), time.monotonic() - begin
    now_ns, wall_s = asyncio.run(scenario())
    assert now_ns >= 10 * S
    assert 0.1 <= wall_s < 2


def test_a_cancelled_sleep_leaves_the_clock_usable() -> None:
    async def scenario() -> bool:
        with RealClock() as clock:
            sleeping = asyncio.ensure_future(clock.sleep_until_ns(3600 * S))
            await asyncio.sleep(0)
            sleeping.cancel()
            await asyncio.gather(sleeping, return_exceptions=True)
            await clock.sleep_until_ns(clock.now_ns() + 5 * MS)
            return sleeping.cancelled()
    assert asyncio.run(scenario())


@pytest.mark.parametrize("columns", ["100", "40"])
def test_on_a_terminal_a_run_shows_how_it_stands(columns: str) -> None:
    ours, theirs = pty.openpty()
    environment = {**os.environ, "COLUMNS": columns, "LINES": "30", "TERM": "xterm"}
    with subprocess.Popen([sys.executable, "-m", "plcemu", "run", str(BATCH), "--set", "port=0",
                           "--set", "time_scale=100"], stdin=theirs, stdout=theirs, stderr=theirs,
                          env=environment) as process:
        os.close(theirs)
        seen: list[bytes] = []

        def shows(*words: str) -> bool:
            with contextlib.suppress(OSError):  # how a terminal says that nobody writes any more
                seen.append(os.read(ours, 65536))
            text = re.sub(rb"\x1b\[[0-9;?]*[A-Za-z]", b"", b"".join(seen)).decode(errors="replace")
            return all(word in " ".join(text.split()) for word in words)
        until(lambda: shows("listening on", "overruns 0", "steps CONDITIONS P1", "batches 0",
                            "no_P1_with_P2", "presumably satisfied", "Modbus 0 clients"),
              "the live view")
        process.send_signal(signal.SIGINT)
        until(lambda: shows("outputs are at their safe values", "STOP at"), "the report")
        assert process.wait(20) == 0
    os.close(ours)
    assert b"Traceback" not in b"".join(seen)


def test_the_daemon_runs_with_the_real_time_settings_asked_for(tmp_path: Path) -> None:
    cpu = min(os.sched_getaffinity(0))
    config = write_config(tmp_path, "program: main.il\nmodbus: {port: 0}\n"
                                    f"realtime: {{cpus: [{cpu}]}}\n")
    with Command("run", config, "--json") as daemon:
        daemon.wait_for("listening")
        process = Path("/proc") / str(daemon.pid)
        until(lambda: (process / "timerslack_ns").read_text().strip() == "1", "the timer slack")
        assert os.sched_getaffinity(daemon.pid) == {cpu}
        assert daemon.stop()[0] == 0


def test_the_daemon_takes_fifo_or_says_what_it_needs_and_goes_on(tmp_path: Path) -> None:
    config = write_config(tmp_path, "program: main.il\nmodbus: {port: 0}\n"
                                    "realtime: {scheduler: fifo, priority: 7}\n")
    with Command("run", config, "--json") as daemon:
        daemon.wait_for("listening")
        until(lambda: _is_fifo(daemon.pid, 7) or "LimitRTPRIO" in daemon.text, "fifo or a warning")
        assert daemon.stop()[0] == 0


def _is_fifo(pid: int, priority: int) -> bool:
    return (os.sched_getscheduler(pid) & ~os.SCHED_RESET_ON_FORK,
            os.sched_getparam(pid).sched_priority) == (os.SCHED_FIFO, priority)
