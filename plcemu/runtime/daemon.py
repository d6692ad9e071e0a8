"""The daemon: the cycle in real time beside the Modbus server, until it is told to stop."""

from __future__ import annotations

import asyncio
import logging
import signal
from collections.abc import Callable
from typing import Any

from plcemu.engine.resource import State
from plcemu.modbus import ModbusTcpServer
from plcemu.runtime.clock import RealClock
from plcemu.runtime.realtime import real_time
from plcemu.runtime.system import System

_LOG = logging.getLogger("plcemu.run")

GRACE_S = 0.2
"""How long the server still answers after the outputs went to their safe values, in s."""

TELL_EVERY_S = 5.0
"""The shortest time between two log lines about overruns, in s."""


class Daemon:
    """Runs a system in real time.

    Args:
        system: ready to run.
        until_ns: when to stop by itself, in the PLC's time; None is never.
    """

    def __init__(self, system: System, until_ns: int | None = None) -> None:
        self.system = system
        self.server: ModbusTcpServer | None = None
        self._until_ns = until_ns
        self._stop = asyncio.Event()
        self._cycling: asyncio.Task[None] | None = None
        self._clock: RealClock | None = None
        self._teller = _Teller(system)

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
        if system.not_judged:
            _LOG.info("not judged without the plant: %s", ", ".join(system.not_judged))
        self._catch_signals()
        settings = system.config.realtime
        try:
            with real_time(settings), RealClock(system.config.speed, settings.spin) as clock:
                self._clock = clock
                self._cycling = asyncio.ensure_future(
                    system.cycle.run(clock, self._stop, self._until_ns, self._after_lap(on_lap)))
                await self._cycling
        except asyncio.CancelledError:
            if not self._stop.is_set():
                raise
        finally:
            await self._shut_down()

    def _after_lap(self, on_lap: Callable[[], None] | None) -> Callable[[], None]:
        def after_lap() -> None:
            if self.server is not None:
                self.server.new_scan(self._serve_until_s())
            self._teller.tell()
            if on_lap is not None:
                on_lap()
        return after_lap

    def _serve_until_s(self) -> float | None:
        """Return until when requests are served: a while before the next release."""
        if self._clock is None:
            return None
        return (self._clock.wall_ns(self.system.cycle.t_ns)
                - self.system.config.realtime.reserve) / 1e9

    def _catch_signals(self) -> None:
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            try:
                loop.add_signal_handler(number, self.stop, f"{signal.Signals(number).name}")
            except (NotImplementedError, RuntimeError, ValueError):
                return  # not the main thread, or a platform without: the caller stops us

    async def _shut_down(self) -> None:
        """Publish safe outputs while clients can still read them, then close the server."""
        if self.system.resource.state is State.RUN:
            self.system.resource.stop()
        self.system.exchange.update_outputs()
        _LOG.info("outputs are at their safe values")
        if self.server is not None:
            self.server.budget = None
            self.server.new_scan()
            if self.server.counters["connections_open"]:
                await asyncio.sleep(GRACE_S)
            await self.server.stop()

    def report(self) -> dict[str, Any]:
        """Return how things stand: the system's report, the server's counters, the timing."""
        counters = self.system.cycle.counters
        document = self.system.report()
        document["timing"] = {
            "max_lap_ms": counters.max_lap_ns / 1e6, "max_late_ms": counters.max_late_ns / 1e6}
        if self.server is not None:
            document["modbus"] = dict(self.server.counters)
        return document


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
