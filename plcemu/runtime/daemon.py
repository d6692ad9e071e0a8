"""The daemon: the cycle in real time beside the Modbus server, until it is told to stop."""

from __future__ import annotations

import asyncio
import logging
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

from plcemu.base.errors import PlcemuError
from plcemu.base.time import NS_PER_S
from plcemu.engine.resource import State
from plcemu.modbus import ModbusTcpServer
from plcemu.runtime.change import Change, ChangeReport
from plcemu.runtime.clock import RealClock
from plcemu.runtime.commands import Commands
from plcemu.runtime.config import Config
from plcemu.runtime.control import ControlServer, socket_path
from plcemu.runtime.historian import Historian, Keep, check_place
from plcemu.runtime.notify import Notifier
from plcemu.runtime.realtime import real_time
from plcemu.runtime.system import System

_LOG = logging.getLogger("plcemu.run")

FIFO_REST = 0.1
"""What part of the time to the next release stays free of requests under SCHED_FIFO.

Linux suspends real-time processes that take over 95 % of a second (`sched_rt_runtime_us`), for the
rest of it: a client that floods the server must not bring that upon the cycle.
"""

GRACE_S = 0.2
"""How long the server still answers after the outputs went to their safe values, in s."""

TELL_EVERY_S = 5.0
"""The shortest time between two log lines about overruns, in s."""


SWITCH_S = 0.0005
"""How long another thread, such as one that compiles, may hold up the cycle at a time, in s."""

T = TypeVar("T")


class StoppingError(PlcemuError):
    """A request came while the PLC was ending."""


class Daemon:
    """Runs a system in real time.

    Args:
        system: ready to run.
        until_ns: when to stop by itself, in the PLC's time; None is never.
        read_config: reads the configuration anew, for a reload; None reloads the same.

    Attributes:
        changes: online changes so far.
    """

    def __init__(self, system: System, until_ns: int | None = None,
                 read_config: Callable[[], Config] | None = None) -> None:
        self.system = system
        self.changes = 0
        self._read_config = read_config or (lambda: system.config)
        self._control: ControlServer | None = None
        self._notifier = Notifier()
        self._reloading = asyncio.Lock()
        self._tasks: set[asyncio.Task[Any]] = set()
        self._work: list[tuple[Callable[[], Any], asyncio.Future[Any], bool]] = []
        self._effects: list[tuple[asyncio.Future[Any], Any]] = []
        self.server: ModbusTcpServer | None = None
        self._until_ns = until_ns
        self._stop = asyncio.Event()
        self._cycling: asyncio.Task[None] | None = None
        self._clock: RealClock | None = None
        self._teller = _Teller(system)
        self._historian: Historian | None = None

    def stop(self, why: str) -> None:
        """End the run at once, after the lap that is under way."""
        if not self._stop.is_set():
            _LOG.info("stopping: %s", why)
            self._stop.set()
            if self._cycling is not None:
                self._cycling.cancel()

    async def run(self, on_lap: Callable[[], None] | None = None) -> None:
        """Serve and cycle until stopped; then bring the outputs to their safe values.

        Raises:
            ListenError: the Modbus server cannot listen.
        """
        system = self.system
        if system.config.modbus.enabled:
            self.server = system.server()
            await self.server.start()
        if system.config.control.enabled:
            try:
                self._control = ControlServer(socket_path(system.config), Commands(self).handle)
                await self._control.start()
            except PlcemuError as problem:  # the PLC is worth more than its switchboard
                _LOG.warning("%s", problem)
        if system.not_judged:
            _LOG.info("not judged without the plant: %s", ", ".join(system.not_judged))
        self._historian = _historian(system)
        self._catch_signals()
        settings = system.config.realtime
        try:
            with real_time(settings), RealClock(system.config.speed, settings.spin) as clock:
                self._clock = clock
                self._cycling = asyncio.ensure_future(
                    system.cycle.run(clock, self._stop, self._until_ns, self._after_lap(on_lap)))
                self._notifier.tell(READY=1, STATUS=self._status())
                await self._cycling
        except asyncio.CancelledError:
            if not self._stop.is_set():
                raise
        finally:
            await self._shut_down()

    def _after_lap(self, on_lap: Callable[[], None] | None) -> Callable[[], None]:
        system = self.system

        def after_lap() -> None:
            if self.server is not None:
                self.server.new_scan(self._serve_until_s())
            self._notifier.alive()
            if system.retention is not None:
                system.retention.after_scan(system.cycle.scan_number - 1)
            if self._work or self._effects:
                self._between_scans()
            self._teller.tell()
            if on_lap is not None:
                on_lap()
        return after_lap

    def _serve_until_s(self) -> float | None:
        """Return until when requests are served: a while before the next release."""
        if self._clock is None:
            return None
        release, realtime = self._clock.wall_ns(self.system.cycle.t_ns), self.system.config.realtime
        reserve = realtime.reserve
        if realtime.scheduler == "fifo":
            reserve = max(reserve, int((release - time.monotonic_ns()) * FIFO_REST))
        return (release - reserve) / 1e9

    def _catch_signals(self) -> None:
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            try:
                loop.add_signal_handler(number, self.stop, f"{signal.Signals(number).name}")
            except (NotImplementedError, RuntimeError, ValueError):
                return  # not the main thread, or a platform without: the caller stops us
        loop.add_signal_handler(signal.SIGHUP, self._reload_soon)

    # ------------------------------------------------------------ between two scans

    async def between_scans(self, work: Callable[[], T], takes_effect: bool = False) -> T:
        """Do something between two scans and return what it gives.

        Args:
            work: what to do.
            takes_effect: whether to return only after the scan that follows.

        Raises:
            PlcemuError: raised by the work, or the PLC is ending.
        """
        if self._stop.is_set():
            raise StoppingError("the PLC is ending")
        done: asyncio.Future[T] = asyncio.get_running_loop().create_future()
        self._work.append((work, done, takes_effect))
        return await done

    def _between_scans(self) -> None:
        effects, self._effects = self._effects, []
        for done, result in effects:
            if not done.done():
                done.set_result(result)
        waiting, self._work = self._work, []
        for work, done, takes_effect in waiting:
            if done.done():  # who asked has gone
                continue
            try:
                result = work()
            except PlcemuError as problem:
                done.set_exception(problem)
                continue
            if takes_effect:
                self._effects.append((done, result))
            else:
                done.set_result(result)

    def _end_waiting(self) -> None:
        """Answer whoever still waits for a scan."""
        for done in [*(done for _, done, _ in self._work), *(done for done, _ in self._effects)]:
            if not done.done():
                done.set_exception(StoppingError("the PLC is ending"))
        self._work, self._effects = [], []

    # ------------------------------------------------------------ online change

    def _reload_soon(self) -> None:
        task = asyncio.ensure_future(self._reload_and_tell())
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _reload_and_tell(self) -> None:
        with suppress(PlcemuError):  # which is told already
            await self.reload()

    async def reload(self) -> ChangeReport:
        """Read the configuration's program anew and go on with it.

        It is compiled in a thread of its own and takes over between two scans.

        Raises:
            PlcemuError: the program or the configuration is wrong; the old program goes on.
        """
        async with self._reloading:
            self._notifier.reloading()
            try:
                config, change = await self._prepare()
                report = await self.between_scans(lambda: self._take_over(config, change))
            except PlcemuError as problem:
                _LOG.error("reload refused, the old program goes on:\n%s", problem)
                raise
            finally:
                self._notifier.tell(READY=1, STATUS=self._status())
        _LOG.info("reloaded: %s", report)
        return report

    async def _prepare(self) -> tuple[Config, Change]:
        def prepare() -> tuple[Config, Change]:
            config = self._read_config()
            return config, self.system.prepare_change(config)

        with _short_switches():
            return await asyncio.get_running_loop().run_in_executor(None, prepare)

    def _take_over(self, config: Config, change: Change) -> ChangeReport:
        fixed = self.system.fixed_keys(config)
        if fixed:
            _LOG.warning("these keys changed as well, which needs a new start: %s",
                         ", ".join(fixed))
        report = change.apply()
        self.system.changed(config)
        self.changes += 1
        return report

    async def commit(self) -> dict[str, Any]:
        """Put the retained variables as they are after a scan on the disk.

        Raises:
            PlcemuError: nothing is retained, or it cannot be written.
        """
        retention = self.system.retention
        if retention is None:
            raise PlcemuError("the program has no retained variables, or retain.enabled is false")
        await self.between_scans(lambda: retention.hand_over(self.system.cycle.scan_number - 1))
        progress = await asyncio.get_running_loop().run_in_executor(None, retention.wait)
        if progress.error:
            raise PlcemuError(progress.error)
        return {"commits": progress.sequence, "scan": progress.scan}

    def _status(self) -> str:
        return f"{self.system.config.name or 'PLC'}: {self.system.resource.state.value}"

    # ------------------------------------------------------------ the end

    async def _shut_down(self) -> None:
        """Publish safe outputs while clients can still read them, then close the server.

        The last commit of the retained variables comes before the wait for clients.
        """
        self._notifier.tell(STOPPING=1)
        self._end_waiting()
        if self.system.resource.state is State.RUN:
            self.system.resource.stop()
        self.system.exchange.update_outputs()
        _LOG.info("outputs are at their safe values")
        if self.system.retention is not None:
            self.system.retention.finish(self.system.cycle.scan_number - 1)
        if self._historian is not None:
            await asyncio.get_running_loop().run_in_executor(None, self._historian.close)
        self.system.close()
        if self._control is not None:
            await self._control.stop()
        if self.server is not None:
            self.server.budget = None
            self.server.new_scan()
            if self.server.counters["connections_open"]:
                await asyncio.sleep(GRACE_S)
            await self.server.stop()
        self._notifier.close()

    def report(self) -> dict[str, Any]:
        """Return how things stand: the system's report, the server's counters, the timing."""
        counters = self.system.cycle.counters
        document = self.system.report()
        document["timing"] = {
            "max_lap_ms": counters.max_lap_ns / 1e6, "max_late_ms": counters.max_late_ns / 1e6}
        if self.server is not None:
            document["modbus"] = dict(self.server.counters)
        if self._historian is not None:
            document["historian"] = {"file": str(self._historian.path),
                                     **self._historian.counters.as_json()}
        return document


def _historian(system: System) -> Historian | None:
    """Return the configured historian at work, or None.

    Raises:
        PlcemuError: its file cannot be used.
    """
    section = system.config.historian
    if section.file is None:
        return None
    check_place(Path(section.file))
    size = None if section.megabytes is None else section.megabytes * 1_000_000
    historian = Historian(Path(section.file), system.config.name, lambda: system.cycle.tags,
                          section.tags, Keep(section.keep, size), section.interval / NS_PER_S)
    system.cycle.observers.append(historian)
    return historian


@contextmanager
def _short_switches() -> Iterator[None]:
    """Let a busy thread give way to the cycle after a short while."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(min(before, SWITCH_S))
    try:
        yield
    finally:
        sys.setswitchinterval(before)


class _Teller:
    """Says in the log what a person at the machine wants to know, once each."""

    def __init__(self, system: System) -> None:
        self._system = system
        self._state = State.RUN
        self._told_overruns = 0
        self._told_at_ns = 0
        self._violated: set[str] = set()
        self._undecided = system.cycle.suite.undecided

    def tell(self) -> None:
        """Compare with what was told last; log what is new."""
        system = self._system
        if system.resource.state is not self._state:
            self._state = system.resource.state
            if self._state is State.FAULT:
                _LOG.error("FAULT: %s; outputs are at their safe values", system.resource.fault)
            else:
                _LOG.info("%s", self._state.value)
        if system.cycle.suite.undecided != self._undecided:
            self._undecided = system.cycle.suite.undecided
            self._tell_verdicts()
        self._tell_overruns()

    def _tell_verdicts(self) -> None:
        for result in self._system.cycle.suite.results():
            if result.failed and result.name not in self._violated:
                self._violated.add(result.name)
                _LOG.error("property %s is violated: %s", result.name, result.formula)

    def _tell_overruns(self) -> None:
        counters, t_ns = self._system.cycle.counters, self._system.cycle.t_ns
        new = counters.overruns - self._told_overruns
        if new and t_ns - self._told_at_ns >= TELL_EVERY_S * 1e9:
            self._told_at_ns, self._told_overruns = t_ns, counters.overruns
            _LOG.warning("%d overruns (%d in all, %d releases missed); the longest lap took "
                         "%.1f ms", new, counters.overruns, counters.missed,
                         counters.max_lap_ns / 1e6)
