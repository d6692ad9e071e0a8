"""The soft plant alone: steps against any PLC over Modbus, through outages and restarts.

While there is no connection the plant goes on with the outputs it saw last, as real ones do. Its
state is kept in a file, so that a plant that was killed goes on where it was.
"""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import json
import logging
import os
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hil.coupling import Coupling
from hil.modbus_plant import FieldLinkError, ModbusPlant
from plcemu.base.errors import PlcemuError
from plcemu.runtime.clock import RealClock
from plcemu.runtime.config import Config

_LOG = logging.getLogger("plcemu.plant")

RETRY_NS = 500_000_000
"""Time between two attempts to connect, in ns."""

KEEP_NS = 200_000_000
"""Time between two savings of the plant's state, in ns."""

REFRESH_NS = 1_000_000_000
"""Time after which all inputs are written again, changed or not, in ns."""

RESUME_WITHIN_S = 600.0
"""How old a state left by a killed plant may be to go on from it, in s."""


@dataclass(frozen=True, slots=True)
class Left:
    """What an earlier plant left: its state, the PLC's run it belongs to, and its age in s."""

    state: dict[str, Any]
    run_id: str
    age_s: float


class StateFile:
    """Where a plant's state survives a kill; removed when the user ends the plant.

    Args:
        path: of the file.
        key: what the state belongs to: the plant's configuration and the PLC.
    """

    def __init__(self, path: Path, key: str) -> None:
        self._path, self._key = path, key

    @classmethod
    def of(cls, config: Config, where: str, path: Path | None = None) -> StateFile:
        """Return the file for a plant of this configuration at this PLC.

        Args:
            config: of the plant.
            where: which PLC.
            path: of the file; by default one in the temporary folder, of this user.

        Raises:
            PlcemuError: there can be no such file.
        """
        key = hashlib.sha256(f"{config.plant!r} {where}".encode()).hexdigest()[:16]
        if path is not None:
            return cls(path, key)
        folder = Path(tempfile.gettempdir()) / f"plcemu-{os.getuid()}"
        try:
            folder.mkdir(mode=0o700, exist_ok=True)
        except OSError as problem:
            raise PlcemuError(f"{folder}: cannot be made: {problem.strerror}; choose a file "
                              "with --state") from None
        return cls(folder / f"plant-{key}.json", key)

    def save(self, snapshot: dict[str, Any], run_id: str) -> None:
        """Write the state and the PLC's run; a kill at any instant leaves the old or the new whole.

        Raises:
            PlcemuError: the file cannot be written.
        """
        text = json.dumps({"key": self._key, "saved": time.time(), "run": run_id,
                           "state": snapshot})
        beside = self._path.with_name(self._path.name + ".new")
        try:
            beside.write_text(text, encoding="utf-8")
            beside.replace(self._path)
        except OSError as problem:
            raise PlcemuError(f"{self._path}: cannot keep the plant's state: "
                              f"{problem.strerror}") from None

    def load(self) -> Left | None:
        """Return what an earlier plant left, if there is something to go on from."""
        try:
            document = json.loads(self._path.read_text(encoding="utf-8"))
            age = time.time() - float(document["saved"])
            if document["key"] == self._key and 0 <= age <= RESUME_WITHIN_S:
                return Left(document["state"], str(document["run"]), age)
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            pass
        return None

    def remove(self) -> None:
        """Forget the state."""
        with contextlib.suppress(OSError):
            self._path.unlink()


class RemotePlant:
    """Runs a coupled plant against a PLC in real time.

    Args:
        link: the plant as a Modbus client.
        period_ns: time between two steps.
        state: where its state is kept, or None.
        fresh: whether to start anew, also if an earlier plant left its state.

    Attributes:
        steps: exchanges with the PLC.
        outages: how often the connection was lost.

    Raises:
        PlcemuError: the state cannot be kept.
    """

    def __init__(self, link: ModbusPlant, period_ns: int, state: StateFile | None,
                 fresh: bool = False) -> None:
        self._link, self._period_ns, self._state = link, period_ns, state
        self._coupling: Coupling = link.coupling
        self._left = None if state is None or fresh else state.load()
        self._run_id = ""
        self._connected = self._begun = False
        self._told = ""
        self._saved_ns = self._refreshed_ns = self._next_try_ns = 0
        self._running: asyncio.Task[None] | None = None
        self._stopping = False
        self.outages = 0
        self.steps = 0
        if state is not None and self._left is None:
            state.save(self._coupling.plant.snapshot(), self._run_id)

    async def run(self, until_ns: int | None = None) -> None:
        """Step until stopped, or until an instant of the clock."""
        self._running = asyncio.ensure_future(self._steps(until_ns))
        try:
            await self._running
        except asyncio.CancelledError:
            if not self._stopping:
                raise
        finally:
            self._link.close()

    def stop(self) -> None:
        """End the run at once, also within a long period."""
        # The Modbus client turns a cancellation into an error of the request: hence the flag.
        self._stopping = True
        if self._running is not None:
            self._running.cancel()

    async def _steps(self, until_ns: int | None) -> None:
        with RealClock() as clock:
            t_ns = 0
            while not self._stopping and (until_ns is None or t_ns < until_ns):
                await clock.sleep_until_ns(t_ns)
                await self._step(clock)
                # Absolute deadlines: a late step does not shift those after it.
                t_ns = max(t_ns + self._period_ns,
                           clock.now_ns() // self._period_ns * self._period_ns)

    def end(self, forget: bool) -> None:
        """Leave the state as it is now for the next start, or forget it."""
        if self._state is not None:
            if forget:
                self._state.remove()
            elif self._begun:
                self._keep(self._state)

    async def _step(self, clock: RealClock) -> None:
        now = clock.now_ns()
        if self._connected or now >= self._next_try_ns:
            await self._exchange(clock)
        elif self._begun:
            self._coupling.advance(now)
        if self._state is not None and self._begun and now - self._saved_ns >= KEEP_NS:
            self._saved_ns = now
            self._keep(self._state)

    def _keep(self, state: StateFile) -> None:
        try:
            state.save(self._coupling.plant.snapshot(), self._run_id)
        except PlcemuError as problem:
            self._tell(str(problem))

    async def _exchange(self, clock: RealClock) -> None:
        try:
            if not self._connected:
                await self._link.connect()
                self._run_id = await self._link.run_id()
            now = clock.now_ns()
            if not self._begun:
                self._begin(now)
            everything = now - self._refreshed_ns >= REFRESH_NS
            if everything:
                self._refreshed_ns = now
            await self._link.exchange(now, everything)
        except FieldLinkError as problem:
            self._lost(str(problem), clock.now_ns())
            return
        self.steps += 1
        if not self._connected:
            self._connected, self._told = True, ""
            _LOG.info("connected; the plant stands at %.1f s", self._coupling.plant.t_ns / 1e9)

    def _begin(self, now: int) -> None:
        """Start when the PLC is first there: where an earlier plant stopped, or anew.

        A state belongs to one run of the PLC; a PLC that has started anew meets a fresh plant. Of
        a PLC that does not show its run it is taken that it has gone on.
        """
        self._begun, left = True, self._left
        if left is not None and left.run_id == self._run_id:
            try:
                self._coupling.plant.restore(left.state)
                _LOG.warning("going on from the state of a plant that ended without notice "
                             "%.0f s ago; --fresh starts anew", left.age_s)
            except Exception as problem:  # the state comes from a file, which may hold anything
                _LOG.warning("the state that a plant left does not fit (%s): starting anew",
                             problem)
        elif left is not None:
            _LOG.info("the PLC has started anew since a plant left its state: so does the plant")
        self._coupling.begin(now)
        if self._state is not None:
            self._keep(self._state)

    def _lost(self, problem: str, now: int) -> None:
        self._link.close()
        if self._stopping:
            return
        self._next_try_ns = now + RETRY_NS
        if self._connected:
            self._connected, self.outages = False, self.outages + 1
            _LOG.warning("connection lost (%s); the plant goes on with the outputs as they were",
                         problem)
        else:
            self._tell(f"{problem}; trying again every {RETRY_NS / 1e9:g} s")

    def _tell(self, problem: str) -> None:
        """Log a problem that lasts, once."""
        if problem != self._told:
            self._told = problem
            _LOG.warning("%s", problem)

    def report(self) -> dict[str, Any]:
        """Return the plant's report, with the link's counters."""
        return {"plant": self._coupling.plant.report(), "steps": self.steps,
                "outages": self.outages}
