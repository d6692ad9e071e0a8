"""A run as curves over time, drawn by matplotlib (extra `plot`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from plcemu.base.errors import PlcemuError, UnknownNameError
from plcemu.base.trace import Trace

FORMATS = (".svg", ".pdf", ".png")
CURVES = 12
"""Numbers and switches drawn where the configuration names none."""

_WIDTH_IN, _PANEL_IN, _SWITCH_IN = 10.0, 2.6, 0.42
"""Width of a figure, and heights of a panel of curves and of one switch, inches."""

_SWING = 0.7
"""Height of a switch that is on, where the switches stand 1 apart."""


def check_plot(path: Path) -> None:
    """Refuse before a long run what cannot be drawn after it.

    Raises:
        PlcemuError: the ending is unknown, or matplotlib is not installed.
    """
    if path.suffix.lower() not in FORMATS:
        raise PlcemuError(f"--plot {path}: found the ending {path.suffix!r}, expected one of "
                          f"{', '.join(FORMATS)}")
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        raise PlcemuError("--plot needs matplotlib: install it with pip install 'plcemu[plot]'"
                          ) from None


def panels_of(trace: Trace, chosen: Mapping[str, Sequence[str]]) -> dict[str, list[int]]:
    """Return what to draw: panel title to the indices of tags.

    Where nothing is chosen, the tags that changed most: numbers in one panel, switches in another.

    Raises:
        PlcemuError: a chosen tag does not exist.
    """
    try:
        found = {title: [trace.tags.find(name) for name in names]
                 for title, names in chosen.items()}
    except UnknownNameError as problem:
        raise PlcemuError(f"plot: {problem}") from None
    if found:
        return found
    changes: dict[int, int] = {}
    for frame in trace.frames[1:]:
        for index, _ in frame.changes:
            changes[index] = changes.get(index, 0) + 1
    busiest = sorted(changes, key=lambda i: -changes[i])
    switches = [i for i in busiest if trace.tags[i].type == "BOOL"][:CURVES]
    numbers = [i for i in busiest if trace.tags[i].type in ("REAL", "LREAL")][:CURVES]
    panels = {"value": sorted(numbers), "switch state": sorted(switches)}
    return {title: tags for title, tags in panels.items() if tags}


def save_plot(trace: Trace, panels: Mapping[str, Sequence[int]], path: Path,
              title: str = "") -> None:
    """Draw a panel for each title, below one another over one time axis.

    Raises:
        PlcemuError: the file cannot be written.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    heights = [_PANEL_IN if _numbers(trace, tags) else _SWITCH_IN * (len(tags) + 1)
               for tags in panels.values()] or [_PANEL_IN]
    figure = Figure(figsize=(_WIDTH_IN, sum(heights) + 1.0), layout="constrained")
    axes = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)
    for axis, (label, tags) in zip(axes[:, 0], panels.items(), strict=False):
        axis.set_ylabel(label)
        (_draw_numbers if _numbers(trace, tags) else _draw_switches)(axis, trace, tags)
        axis.grid(alpha=0.3)
    axes[-1, 0].set_xlabel("time in s")
    axes[-1, 0].set_xlim(0, max(trace.end_ns, 1) / 1e9)
    figure.suptitle(title)
    metadata = {"Date": None} if path.suffix.lower() == ".svg" else None
    try:
        with rc_context({"svg.hashsalt": "plcemu"}):  # so that equal runs are equal files
            figure.savefig(path, metadata=metadata)
    except OSError as problem:
        raise PlcemuError(f"{path}: cannot be written: {problem.strerror}") from None


def _numbers(trace: Trace, tags: Sequence[int]) -> bool:
    return any(trace.tags[i].type != "BOOL" for i in tags)


def _steps(trace: Trace, index: int) -> tuple[list[float], list[float]]:
    """Return times in s and values; each value holds until the next time."""
    history = trace.history(trace.tags[index].name)
    history.append((max(trace.end_ns, history[-1][0]), history[-1][1]))
    return [t / 1e9 for t, _ in history], [_as_number(value) for _, value in history]


def _as_number(value: Any) -> float:
    return float(value) if isinstance(value, bool | int | float) else float("nan")


def _draw_numbers(axis: Any, trace: Trace, tags: Sequence[int]) -> None:
    for index in tags:
        tag = trace.tags[index]
        unit = f" in {tag.unit}" if tag.unit else ""
        axis.plot(*_steps(trace, index), drawstyle="steps-post", label=f"{tag.name}{unit}")
    axis.legend(loc="upper right")


def _draw_switches(axis: Any, trace: Trace, tags: Sequence[int]) -> None:
    for row, index in enumerate(reversed(tags)):
        times, values = _steps(trace, index)
        axis.plot(times, [row + _SWING * v for v in values], drawstyle="steps-post")
        axis.fill_between(times, row, [row + _SWING * v for v in values], step="post", alpha=0.3)
    axis.set_yticks([row + _SWING / 2 for row in range(len(tags))],
                    [trace.tags[i].name.rpartition(".")[2] for i in reversed(tags)])
    axis.set_ylim(-0.2, len(tags))
