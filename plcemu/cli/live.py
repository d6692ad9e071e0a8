"""The live view of `plcemu run` on a terminal."""

from __future__ import annotations

import time
from types import TracebackType
from typing import Self

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from plcemu.cli.output import properties_table
from plcemu.runtime.daemon import Daemon

REFRESH_S = 0.5
"""Time between two pictures, in s."""

ROWS = 12
"""Properties shown at most; violated and pending ones come first."""


class LiveView:
    """Shows scan time, overruns, active steps, verdicts and plant counters while a daemon runs.

    Pictures are drawn from the cycle's own turn, never from another thread.
    """

    def __init__(self, daemon: Daemon) -> None:
        self._daemon = daemon
        self._steps = [i for i, tag in enumerate(daemon.system.resource.memory.tags)
                       if tag.name.endswith(".X")]
        self._live = Live(console=Console(stderr=True), auto_refresh=False)
        self._drawn = 0.0

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self._live.update(self._picture(), refresh=True)
        self._live.stop()

    def on_lap(self) -> None:
        """Draw a new picture if the last one is old."""
        now = time.monotonic()
        if now - self._drawn >= REFRESH_S:
            self._drawn = now
            self._live.update(self._picture(), refresh=True)

    def _picture(self) -> RenderableType:
        system, server = self._daemon.system, self._daemon.server
        counters = system.cycle.counters
        state = Text(f"{system.config.name or 'PLC'}  {system.resource.state.value}",
                     style="bold green" if system.resource.fault is None else "bold red")
        facts = Table.grid(padding=(0, 2))
        facts.add_row("time", f"{system.cycle.t_ns / 1e9:.1f} s",
                      "scans", str(system.cycle.scan_number),
                      "overruns", f"{counters.overruns} ({counters.missed} missed)")
        facts.add_row("lap", f"{counters.last_lap_ns / 1e6:.2f} ms, max "
                      f"{counters.max_lap_ns / 1e6:.2f}",
                      "late", f"{counters.late_ns / 1e6:.2f} ms, max "
                      f"{counters.max_late_ns / 1e6:.2f}",
                      "Modbus", self._modbus(server.counters if server else None))
        parts: list[RenderableType] = [state, facts, Text("steps  " + self._active_steps())]
        parts += self._plant_and_verdicts()
        return Group(*parts)

    @staticmethod
    def _modbus(counters: dict[str, int] | None) -> str:
        if counters is None:
            return "off"
        return f"{counters['connections_open']} clients, {counters['requests']} requests"

    def _active_steps(self) -> str:
        memory = self._daemon.system.resource.memory
        names = [memory.tags[i].name.removesuffix(".X") for i in self._steps if memory.read(i)]
        shown = [n.rsplit(".", 1)[-1] for n in names]
        return " ".join(shown[:24]) + (" ..." if len(shown) > 24 else "") or "-"

    def _plant_and_verdicts(self) -> list[RenderableType]:
        system, parts = self._daemon.system, list[RenderableType]()
        if system.plant is not None:
            if system.plant.stepped_aside:
                parts.append(Text("plant  outside: a client drives the field inputs"))
            else:
                facts = system.plant.coupling.plant.observe()
                parts.append(Text("plant  " + "  ".join(
                    f"{k} {v:g}" if isinstance(v, float) else f"{k} {v}"
                    for k, v in facts.items() if v)))
        results = [r.as_json() for r in system.cycle.suite.results()]
        results.sort(key=lambda r: str(r["verdict"]).endswith("satisfied"))
        if results:
            parts.append(properties_table(results[:ROWS]))
            if len(results) > ROWS:
                parts.append(Text(f"... and {len(results) - ROWS} more, none of them violated"
                                  if results[ROWS]["verdict"] != "violated" else "..."))
        return parts
