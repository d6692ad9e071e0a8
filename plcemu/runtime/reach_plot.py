"""Studies of reachability as pictures, with matplotlib (extra `plot`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Literal

from plcemu.base.errors import PlcemuError
from plcemu.runtime.reach import Found
from plcemu.runtime.variation import magnitude


@dataclass(frozen=True, slots=True)
class Curve:
    """What is drawn.

    Attributes:
        title: above it.
        parameter: the varied one.
        objective: the quantity asked about.
        unit: of the quantity.
        show: the reachable intervals, or the width of what lies between the outermost.
        limit: of the range, drawn as a line; or None.
    """

    title: str
    parameter: str
    objective: str
    unit: str
    show: Literal["interval", "range"]
    limit: Fraction | None = None


def save_plot(file: Path, curve: Curve, answers: Sequence[Found]) -> None:
    """Draw a study.

    Raises:
        PlcemuError: matplotlib is not installed, or the file cannot be written.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise PlcemuError("pictures need matplotlib: pip install 'plcemu[plot]'") from None
    figure = Figure(figsize=(8, 5), layout="constrained")
    axes = figure.add_subplot()
    unit = magnitude(curve.parameter, answers[0].value)[1]
    scale = 1e3 if unit == "s" else 1.0

    def x_of(answer: Found) -> float:
        return magnitude(curve.parameter, answer.value)[0] * scale
    if curve.show == "interval":
        rows = [(x_of(a), float(p.low), float(p.high)) for a in answers
                for p in a.pieces if p.low is not None and p.high is not None]
        axes.vlines([x for x, _, _ in rows], [y for _, y, _ in rows], [y for _, _, y in rows],
                    linewidth=max(0.3, 400 / max(1, len(answers))))
        axes.set_ylabel(f"{curve.objective} [{curve.unit}]")
    else:
        points = [(x_of(a), float(a.range)) for a in answers
                  if a.range is not None]
        axes.plot([x for x, _ in points], [y for _, y in points], linewidth=0.8)
        if curve.limit is not None:
            axes.axhline(float(curve.limit), linestyle="--", linewidth=0.8, color="tab:red")
        axes.set_ylabel(f"range of {curve.objective} [{curve.unit}]")
    axes.set_xlabel(curve.parameter + (" [ms]" if unit == "s" else f" [{unit}]" if unit else ""))
    axes.set_title(curve.title)
    axes.grid(linewidth=0.3)
    try:
        figure.savefig(file)
    except (OSError, ValueError) as problem:
        raise PlcemuError(f"{file}: {getattr(problem, 'strerror', None) or problem}") from None
