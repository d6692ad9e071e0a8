"""A schedule as a Gantt chart: a row for each resource, a bar for each process."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from plcemu.base.errors import PlcemuError

if TYPE_CHECKING:
    from plcemu.runtime.scheduling import Start

_BAR = 0.8
_NARROW = 0.012
"""Part of the chart's width below which a bar has no room for its name."""


def draw(timetable: Sequence[Start], users: Mapping[str, Sequence[str]], unit_s: float, title: str,
         path: Path) -> None:
    """Draw a timetable into a file; its ending says the format.

    Args:
        timetable: processes with begin and end, in units of time.
        users: for each process the resources it uses.
        unit_s: the unit of time, in s.
        title: above the chart.
        path: the file, such as `plan.svg`.

    Raises:
        PlcemuError: matplotlib is not installed, or cannot write such a file.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise PlcemuError("a chart needs matplotlib: pip install 'plcemu[plot]'") from None
    rows = sorted({r for start in timetable for r in users[start.process]})
    colours = {p: f"C{n % 10}" for n, p in enumerate(users)}
    end = max((start.end for start in timetable), default=1)
    figure = Figure(figsize=(14, 1 + 0.5 * max(len(rows), 1)), layout="constrained")
    axes = figure.subplots()
    for start in timetable:
        width = (start.end - start.begin) * unit_s
        for resource in users[start.process]:
            axes.barh(rows.index(resource), width, left=start.begin * unit_s, height=_BAR,
                      color=colours[start.process], edgecolor="white", linewidth=0.5)
            if start.end - start.begin > _NARROW * end:
                axes.text(start.begin * unit_s + width / 2, rows.index(resource), start.process,
                          ha="center", va="center", fontsize=7, color="white")
    axes.set_yticks(range(len(rows)), rows)
    axes.invert_yaxis()
    axes.set_xlabel("time, s")
    axes.set_title(title)
    try:
        figure.savefig(path)
    except ValueError as problem:
        raise PlcemuError(f"--gantt {path}: {problem}") from None
