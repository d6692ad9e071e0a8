"""The live view of `plcemu run` on a terminal."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from types import TracebackType
from typing import Self

from rich.console import Group, RenderableType
from rich.live import Live
from rich.text import Text

from plcemu.cli.output import console, properties_table
from plcemu.runtime.daemon import Daemon

REFRESH_S = 0.5
"""Time between two pictures, in s."""

ROWS = 12
"""Properties shown at most; violated and pending ones come first."""

STEPS = 24
"""Active steps shown at most."""

_ORDER = ("violated", "presumably violated", "inconclusive", "presumably satisfied", "satisfied")


class LiveView:
    """Shows scan time, overruns, active steps, verdicts and plant counters while a daemon runs.

    It begins with the first lap, and gives way to the report at the end. Pictures are drawn from
    the cycle's own turn, never from another thread; log lines come above them.

    Args:
        daemon: what is shown.
        set_up_log: sends the log to where stderr is now.
    """

    def __init__(self, daemon: Daemon, set_up_log: Callable[[], None]) -> None:
        self._daemon, self._set_up_log = daemon, set_up_log
        self._console = console(to_stderr=True)
        self._live = Live(console=self._console, auto_refresh=False, transient=True)
        self._drawn: float | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        if self._drawn is not None:
            self._live.stop()
            self._set_up_log()

    def on_lap(self) -> None:
        """Draw a new picture if the last one is old."""
        now = time.monotonic()
        if self._drawn is None:
            self._live.start()
            self._set_up_log()  # stderr is now the view's
        elif now - self._drawn < REFRESH_S:
            return
        self._drawn = now
        self._live.update(self._picture(), refresh=True)

    def _picture(self) -> RenderableType:
        system, server = self._daemon.system, self._daemon.server
        counters = system.cycle.counters
        state = Text(f"{system.config.title}  {system.resource.state.value}",
                     style="bold green" if system.resource.fault is None else "bold red")
        if system.resource.fault is not None:
            state.append(f"  {system.resource.fault}")
        scans = (f"time {system.cycle.t_ns / 1e9:.1f} s   scans {system.cycle.scan_number}   "
                 f"overruns {counters.overruns} ({counters.missed} missed)")
        laps = (f"lap {counters.last_lap_ns / 1e6:.2f} ms, max {counters.max_lap_ns / 1e6:.2f}   "
                f"late {counters.late_ns / 1e6:.2f} ms, max {counters.max_late_ns / 1e6:.2f}")
        lines = [scans, laps, f"Modbus {self._modbus(server.counters if server else None)}",
                 f"steps {self._active_steps()}", *self._plant()]
        return Group(state, *(Text(line) for line in lines), *self._verdicts())

    @staticmethod
    def _modbus(counters: dict[str, int] | None) -> str:
        if counters is None:
            return "off"
        return f"{counters['connections_open']} clients, {counters['requests']} requests"

    def _active_steps(self) -> str:
        memory = self._daemon.system.resource.memory
        names = [tag.name.split(".")[-2] for i, tag in enumerate(memory.tags)
                 if tag.name.endswith(".X") and memory.read(i)]
        return " ".join(names[:STEPS]) + (" ..." if len(names) > STEPS else "") or "-"

    def _plant(self) -> list[str]:
        plant = self._daemon.system.plant
        if plant is None:
            return []
        if plant.stepped_aside:
            return ["plant outside: a client drives the inputs"]
        facts = plant.coupling.plant.observe()
        shown = [name if value is True else f"{name} {value:g}" for name, value in facts.items()
                 if value > 0 or name == "batches"]
        return [f"plant {plant.coupling.plant.t_ns / 1e9:.0f} s   " + "   ".join(shown)]

    def _verdicts(self) -> list[RenderableType]:
        results = [r.as_json() for r in self._daemon.system.cycle.suite.results()]
        results.sort(key=lambda r: _ORDER.index(str(r["verdict"])))
        if not results:
            return []
        counts = Counter(str(r["verdict"]) for r in results)
        rows = max(1, min(ROWS, self._console.height - 12))
        return [Text("properties " + ", ".join(f"{counts[v]} {v}" for v in _ORDER if counts[v])),
                properties_table(results[:rows], self._console.width, brief=True)]
