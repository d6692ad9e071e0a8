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
from pathlib import Path
from typing import Any

from hil.coupling import Coupling
from hil.modbus_plant import FieldLinkError, ModbusPlant
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


class StateFile:
    """Where a plant's state survives a kill; removed at an orderly end.

    Args:
        path: of the file.
        key: what the state belongs to: the configuration and the PLC.
    """

    def __init__(self, path: Path, key: str) -> None:
        self._path, self._key = path, key

    @classmethod
    def default(cls, config: Config, where: str) -> StateFile:
        """Return the file for a plant of this configuration at this PLC, of this user."""
        key = hashlib.sha256(f"{config.plant!r} {config.program} {where}".encode()).hexdigest()[:16]
        folder = Path(tempfile.gettempdir()) / f"plcemu-{os.getuid()}"
        folder.mkdir(mode=0o700, exist_ok=True)
        return cls(folder / f"plant-{key}.json", key)

    def save(self, snapshot: dict[str, Any]) -> None:
        """Write the state; a kill at any instant leaves the old or the new one whole."""
        text = json.dumps({"key": self._key, "saved": time.time(), "state": snapshot})
        beside = self._path.with_suffix(".new")
        beside.write_text(text, encoding="utf-8")
        beside.replace(self._path)

    def load(self) -> tuple[dict[str, Any], float] | None:
        """Return the state and its age in s, if there is one to go on from."""
        try:
            document = json.loads(self._path.read_text(encoding="utf-8"))
            age = time.time() - float(document["saved"])
            if document["key"] == self._key and 0 <= age <= RESUME_WITHIN_S:
                return document["state"], age
        except (OSError, ValueError, KeyError, TypeError):
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
    """

    def __init__(self, link: ModbusPlant, period_ns: int, state: StateFile | None) -> None:
        self._link, self._period_ns, self._state = link, period_ns, state
        self._coupling: Coupling = link.coupling
        self._connected = False
        self._saved_ns = self._refreshed_ns = 0
        self._next_try_ns = 0
        self.outages = 0
        self.steps = 0

    async def run(self, stop: asyncio.Event, until_ns: int | None = None) -> None:
        """Step until stopped, or until an instant of the clock."""
        with RealClock() as clock:
            t_ns = 0
            while not stop.is_set() and (until_ns is None or t_ns < until_ns):
                await clock.sleep_until_ns(t_ns)
                await self._step(clock)
                # Absolute deadlines: a late step does not shift those after it.
                t_ns = max(t_ns + self._period_ns,
                           clock.now_ns() // self._period_ns * self._period_ns)
        self._link.close()
        if self._state is not None:
            self._state.remove()

    async def _step(self, clock: RealClock) -> None:
        now = clock.now_ns()
        if not self._connected and now >= self._next_try_ns:
            await self._try_to_connect(clock)
        if self._connected:
            await self._exchange(clock.now_ns())
        else:
            self._coupling.advance(now)
        if self._state is not None and now - self._saved_ns >= KEEP_NS:
            self._saved_ns = now
            self._state.save(self._coupling.plant.snapshot())

    async def _try_to_connect(self, clock: RealClock) -> None:
        try:
            await self._link.connect()
            self._connected = True
            _LOG.info("connected; the plant stands at %.1f s", self._coupling.plant.t_ns / 1e9)
        except FieldLinkError as problem:
            if self._next_try_ns == 0:
                _LOG.warning("%s; trying again every %.1f s", problem, RETRY_NS / 1e9)
            self._next_try_ns = clock.now_ns() + RETRY_NS

    async def _exchange(self, now: int) -> None:
        everything = now - self._refreshed_ns >= REFRESH_NS
        if everything:
            self._refreshed_ns = now
        try:
            await self._link.exchange(now, everything)
            self.steps += 1
        except FieldLinkError as problem:
            self._connected, self.outages = False, self.outages + 1
            self._next_try_ns = now + RETRY_NS
            self._link.close()
            _LOG.warning("connection lost (%s); the plant goes on with the outputs as they were",
                         problem)

    def report(self) -> dict[str, Any]:
        """Return the plant's report, with the link's counters."""
        return {"plant": self._coupling.plant.report(), "steps": self.steps,
                "outages": self.outages}
