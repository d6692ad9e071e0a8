"""A bar on a terminal while a cycle runs in virtual time."""

from __future__ import annotations

import sys

from plcemu.base.time import NS_PER_S
from plcemu.runtime.cycle import Cycle

LAPS_SHOWN = 100
"""Laps between two looks at the progress bar, which cost more than a lap."""


def run_with_progress(cycle: Cycle, until_ns: int, dense: bool = False,
                      what: str = "simulating") -> None:
    """Run up to an instant; on a terminal a bar shows how far it has come."""
    if not (sys.stderr.isatty() and until_ns):
        cycle.run_virtual(until_ns, dense=dense)
        return
    # Loaded only where something is drawn.
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    from plcemu.cli.output import console

    columns = (TextColumn(what), BarColumn(),
               TextColumn("{task.completed:.0f} / {task.total:.0f} s"), TimeRemainingColumn())
    with Progress(*columns, console=console(to_stderr=True), transient=True) as progress:
        bar = progress.add_task("", total=until_ns / NS_PER_S)
        laps = 0

        def on_progress(t_ns: int) -> None:
            nonlocal laps
            laps += 1
            if laps % LAPS_SHOWN == 0:
                progress.update(bar, completed=t_ns / NS_PER_S)

        cycle.run_virtual(until_ns, on_progress, dense)
