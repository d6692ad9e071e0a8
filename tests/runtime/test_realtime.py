"""What is asked of the operating system is had, or told of, and undone."""

import asyncio
import ctypes
import gc
import os
from fractions import Fraction
from pathlib import Path

import pytest

from plcemu.runtime import realtime
from plcemu.runtime.clock import RealClock
from plcemu.runtime.config import RealtimeSection, load_config
from plcemu.runtime.daemon import Daemon
from plcemu.runtime.realtime import real_time
from plcemu.runtime.system import System

USABLE = sorted(os.sched_getaffinity(0))


def settings(**values):
    return RealtimeSection.model_validate(values)


def slack_ns():
    return int(Path("/proc/self/timerslack_ns").read_text())


def test_by_default_only_timer_slack_and_collector_change_and_both_are_undone():
    before, frozen = (slack_ns(), os.sched_getscheduler(0)), gc.get_freeze_count()
    with real_time(settings()) as warnings:
        inside = (slack_ns(), os.sched_getscheduler(0))
        assert gc.get_freeze_count() > frozen  # Python 3.12 itself begins with some
    assert (warnings, inside) == ([], (1, before[1]))
    assert (slack_ns(), os.sched_getscheduler(0)) == before
    assert gc.get_freeze_count() <= frozen


def test_the_timer_slack_is_the_one_asked_for():
    with real_time(settings(timer_slack="20us")):
        assert slack_ns() == 20_000


def test_the_process_runs_on_the_processors_named_and_then_on_all_again():
    with real_time(settings(cpus=USABLE[:1])) as warnings:
        assert (os.sched_getaffinity(0), warnings) == ({USABLE[0]}, [])
    assert sorted(os.sched_getaffinity(0)) == USABLE


def test_processors_that_are_not_there_are_told_of():
    with real_time(settings(cpus=[4000])) as warnings:
        assert sorted(os.sched_getaffinity(0)) == USABLE
    known = ", ".join(map(str, USABLE))
    assert warnings == [("realtime.cpus: [4000] cannot be had (Invalid argument); this process may "
                         f"run on {known}")]


def test_fifo_is_asked_for_with_its_priority_and_children_stay_without(monkeypatch):
    asked = []
    monkeypatch.setattr(os, "sched_setscheduler",
                        lambda pid, policy, p: asked.append((pid, policy, p.sched_priority)))
    with real_time(settings(scheduler="fifo", priority=42)) as warnings:
        pass
    assert asked == [(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, 42),
                     (0, os.sched_getscheduler(0), 0)]
    assert warnings == []


def refuse(*arguments):
    raise PermissionError(1, "Operation not permitted")


def test_fifo_that_is_not_permitted_is_a_warning_with_what_to_do(monkeypatch, caplog):
    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    with real_time(settings(scheduler="fifo")) as warnings:
        assert slack_ns() == 1
    assert "fifo cannot be had (Operation not permitted), going on without" in warnings[0]
    assert "LimitRTPRIO" in caplog.text


def test_a_system_without_the_calls_gives_warnings(monkeypatch):
    monkeypatch.delattr(os, "sched_setscheduler")
    monkeypatch.delattr(os, "sched_setaffinity")
    with real_time(settings(scheduler="fifo", cpus=[0])) as warnings:
        pass
    assert ["no such call" in w for w in warnings] == [True, True]


def test_memory_is_not_locked_under_a_limit(monkeypatch):
    monkeypatch.setattr(realtime, "_may_lock", lambda: False)
    with real_time(settings(lock_memory=True)) as warnings:
        pass
    assert "LimitMEMLOCK=infinity" in warnings[0]


class Libc:
    """A C library whose mlockall notes what it is told."""

    def __init__(self, result):
        self.calls, self._result = [], result

    def mlockall(self, flags):
        self.calls.append(flags)
        ctypes.set_errno(12)
        return self._result

    def munlockall(self):
        self.calls.append("undone")


@pytest.mark.parametrize(("result", "calls", "told"), [
    (0, [3, "undone"], []), (-1, [3], ["realtime.lock_memory: cannot be had (Cannot"])])
def test_memory_is_locked_present_and_future(monkeypatch, result, calls, told):
    libc = Libc(result)
    monkeypatch.setattr(realtime, "_may_lock", lambda: True)
    monkeypatch.setattr(realtime, "_libc", lambda: libc)
    with real_time(settings(lock_memory=True)) as warnings:
        pass
    assert libc.calls == calls
    assert [w[:len(t)] for w, t in zip(warnings, told, strict=True)] == told


# ---------------------------------------------------------------- configuration


@pytest.mark.parametrize(("text", "problem"), [
    ("scheduler: rr", "realtime.scheduler: found 'rr', expected 'other' or 'fifo'"),
    ("priority: 100", "realtime.priority: found 100, expected less than or equal to 99"),
    ("cpus: []", "realtime.cpus: found a list, expected list should have at least 1 item"),
    ("timer_slack: 5", "realtime.timer_slack: found 5, expected a number with a unit"),
    ("prioritty: 5", "there is no key 'realtime.prioritty'; did you mean 'priority'?")])
def test_a_wrong_setting_is_told_with_its_place(tmp_path, text, problem):
    path = tmp_path / "config.yaml"
    path.write_text(f"program: x.il\nrealtime:\n  {text}\n")
    with pytest.raises(Exception) as caught:
        load_config(path)
    assert f"{path}:3: {problem}" in str(caught.value)


# ---------------------------------------------------------------- clock


@pytest.mark.parametrize("speed", [Fraction(1), Fraction(20), Fraction(1, 3)])
def test_an_instant_of_the_clock_has_its_place_in_the_loops_time(speed):
    with RealClock(speed) as clock:
        wall_s = clock.wall_ns(600_000_000) - clock.wall_ns(0)
    assert abs(wall_s - 600_000_000 / speed) <= 1


def test_a_clock_that_polls_returns_at_or_after_the_instant():
    async def sleep():
        with RealClock(spin_ns=2_000_000) as clock:
            await clock.sleep_until_ns(5_000_000)
            return clock.now_ns()
    assert asyncio.run(sleep()) >= 5_000_000


@pytest.mark.parametrize(("overrides", "free_ms"), [
    ([], 0.2), (["realtime.scheduler=fifo"], 1.0),
    (["realtime.scheduler=fifo", "realtime.reserve=3ms"], 3.0)])
def test_under_fifo_a_tenth_of_the_time_to_the_release_stays_free_of_requests(
        monkeypatch: pytest.MonkeyPatch, overrides: list[str], free_ms: float) -> None:
    class ReleaseIn10Ms:
        def wall_ns(self, t_ns: int) -> int:
            return 15_000_000

    monkeypatch.setattr("plcemu.runtime.daemon.time.monotonic_ns", lambda: 5_000_000)
    daemon = Daemon(System(load_config("il_programs/batch_plant", overrides)))
    monkeypatch.setattr(daemon, "_clock", ReleaseIn10Ms())
    assert daemon._serve_until_s() == pytest.approx((15 - free_ms) / 1e3)
