"""The results of a sweep as numbers: summaries by grid point, CSV, plots."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Any

from plcemu.base.errors import PlcemuError
from plcemu.base.time import DurationError, parse_duration_ns
from plcemu.runtime.sweep import Design, Plan, Result

VIOLATED = "violated"


@dataclass(frozen=True, slots=True)
class Summary:
    """What the runs of one combination of grid values have in common.

    Attributes:
        point: the values, in the order of the grid's variations.
        runs: how many runs finished.
        numbers: least, mean and greatest of each measure that is a number or a Boolean.
        violated: in how many runs each property was violated; only those that were.
        errors: how many runs faulted or could not be executed.
    """

    point: tuple[str, ...]
    runs: int
    numbers: Mapping[str, tuple[float, float, float]]
    violated: Mapping[str, int]
    errors: int

    def as_json(self, grid: Sequence[str]) -> dict[str, Any]:
        """Return plain values."""
        return {"parameters": dict(zip(grid, self.point, strict=True)), "runs": self.runs,
                "values": {name: {"min": low, "mean": mean, "max": high}
                           for name, (low, mean, high) in self.numbers.items()},
                "violated": dict(self.violated), "errors": self.errors}


def summarise(plan: Plan, results: Sequence[Result]) -> list[Summary]:
    """Return a summary of each combination, in the order in which they were run."""
    groups: dict[tuple[str, ...], list[Result]] = {}
    for result in results:
        groups.setdefault(result.run.point, []).append(result)
    return [_summary(plan, point, group) for point, group in groups.items()]


def _summary(plan: Plan, point: tuple[str, ...], results: Sequence[Result]) -> Summary:
    numbers = {}
    for measure in plan.measures:
        values = [float(v) for r in results
                  if isinstance(v := r.values.get(measure.label), bool | int | float)]
        if values:
            numbers[measure.label] = min(values), fmean(values), max(values)
    violated: dict[str, int] = {}
    for result in results:
        for name, verdict in result.verdicts.items():
            violated[name] = violated.get(name, 0) + (verdict == VIOLATED)
    return Summary(point, len(results), numbers, {n: c for n, c in violated.items() if c},
                   sum(bool(r.error) for r in results))


def save_csv(plan: Plan, design: Design, results: Sequence[Result], path: Path) -> None:
    """Write one row a run: number, parameters, collected values, verdicts.

    Raises:
        PlcemuError: the file cannot be written.
    """
    parameters = list(dict.fromkeys(n for r in results for n in r.run.parameters))
    properties = list(dict.fromkeys(n for r in results for n in r.verdicts))
    labels = [m.label for m in plan.measures]
    try:
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(["run", *parameters, *labels, *properties, "error"])
            for r in results:
                writer.writerow([r.run.number, *(r.run.parameters.get(n, "") for n in parameters),
                                 *(_cell(r.values.get(n, "")) for n in labels),
                                 *(r.verdicts.get(n, "") for n in properties), r.error])
    except OSError as problem:
        raise PlcemuError(f"{path}: cannot be written: {problem.strerror}") from None


def _cell(value: object) -> object:
    return int(value) if isinstance(value, bool) else value


# ---------------------------------------------------------------- plots


def save_plot(plan: Plan, design: Design, results: Sequence[Result], path: Path) -> None:
    """Draw each measure over the first parameter that was varied, with its range where a grid has
    several runs at one value; without a parameter, as a histogram.

    Raises:
        PlcemuError: nothing can be drawn, or the file cannot be written.
    """
    from matplotlib.figure import Figure

    drawn = list(_drawn(plan, results))
    if not drawn:
        raise PlcemuError("--plot: no collected value is a number")
    figure = Figure(figsize=(8, 3.2 * len(drawn)), layout="constrained")
    axes = figure.subplots(len(drawn), 1, squeeze=False)[:, 0]
    for axis, (label, values) in zip(axes, drawn, strict=True):
        if design.variations:
            _draw(axis, design.variations[0].name, label, values, results)
        else:
            axis.hist([y for _, y in values], bins="auto")
            axis.set(xlabel=label, ylabel="runs")
    try:
        figure.savefig(path)
    except OSError as problem:
        raise PlcemuError(f"{path}: cannot be written: {problem.strerror}") from None


def _drawn(plan: Plan, results: Sequence[Result],
           ) -> Iterator[tuple[str, list[tuple[Result, float]]]]:
    """Yield each measure that is a number and not the same everywhere, with its values."""
    for measure in plan.measures:
        values = [(r, float(v)) for r in results
                  if isinstance(v := r.values.get(measure.label), bool | int | float)]
        if len({y for _, y in values}) > 1 or (values and len(plan.measures) == 1):
            yield measure.label, values


def _draw(axis: Any, name: str, label: str, values: Sequence[tuple[Result, float]],
          results: Sequence[Result]) -> None:
    texts = list(dict.fromkeys(r.run.parameters[name] for r in results))
    places, unit = _axis(texts)
    groups: dict[float, list[float]] = {}
    for result, y in values:
        groups.setdefault(places[result.run.parameters[name]], []).append(y)
    points = [(x, y) for x, ys in groups.items() for y in ys]
    axis.plot(*zip(*points, strict=True), ".", markersize=3, alpha=0.6)
    if len(values) > len(groups) > 1:
        xs = sorted(groups)
        axis.fill_between(xs, [min(groups[x]) for x in xs], [max(groups[x]) for x in xs],
                          alpha=0.2)
    if unit is None:
        axis.set_xticks(list(places.values()), list(places))
    axis.set(xlabel=f"{name} ({unit})" if unit else name, ylabel=label)
    axis.grid(alpha=0.3)


def _axis(texts: Sequence[str]) -> tuple[dict[str, float], str | None]:
    """Return where each text stands on an axis, and the axis's unit; None for words."""
    try:
        return {t: float(t) for t in texts}, ""
    except ValueError:
        pass
    try:
        return {t: parse_duration_ns(t) / 1e6 for t in texts}, "ms"
    except DurationError:
        return {t: float(n) for n, t in enumerate(texts)}, None
