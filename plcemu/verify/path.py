"""A run of the closed loop as a table of scans, in the user's names, changes only.

It is a trace as well, so that the online monitors judge it and every recorder can save it.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Hashable, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any

from plcemu.base.time import format_duration
from plcemu.base.trace import Change, Frame, Trace
from plcemu.base.types import Value
from plcemu.io.mapping import Point
from plcemu.verify.check import StateGraph
from plcemu.verify.fair import Lasso, Step
from plcemu.verify.loop import ClosedLoop
from plcemu.verify.predicates import Predicates


@dataclass(slots=True)
class Row:
    """One scan of a path.

    Attributes:
        scan: its number, from 0.
        action: what the plant did before it; empty if nothing.
        changes: tag -> value after the scan, for the tags that it changed.
        inputs: the raw inputs that the scan latched, by port name.
    """

    scan: int
    action: str
    changes: dict[str, Value]
    inputs: dict[str, int]
    values: tuple[Value, ...] = ()


@dataclass(slots=True)
class Path:
    """A run from a cold start.

    Attributes:
        start: the plant's initial state in the user's words.
        rows: its scans.
        repeats_from: the number of the scan from which on the run repeats itself for ever; None
            if the story is over with the last row. If it is the last row, the run stays there.
        fault: why the program stops after the last row; else empty.
        cycle_ns: the time between two scans.
        decided_ns: how long after its last scan it is decided, in ns.
        times: the instant of each row, in ns, where time was kept; else rows are a cycle apart.
        remark: what is to know of the instants; else empty.
        may_go_on: whether something could still happen after the last row, although it need not.
    """

    start: str
    rows: list[Row]
    repeats_from: int | None
    fault: str
    cycle_ns: int
    predicates: Predicates = field(repr=False)
    decided_ns: int = 0
    times: list[int] | None = None
    remark: str = ""
    may_go_on: bool = False

    def at_ns(self, scan: int) -> int:
        """The instant of a scan, also of one that is played again."""
        if self.times is None:
            return scan * self.cycle_ns
        over = scan - len(self.times) + 1
        return self.times[scan] if over <= 0 else self.times[-1] + over * self.cycle_ns

    def as_json(self) -> dict[str, Any]:
        """Return it as plain values, times in s."""
        rows = [{"scan": r.scan, "t_s": self.at_ns(r.scan) / 1e9, "action": r.action,
                 "changes": r.changes} for r in self.rows if r.changes or r.action]
        return {"initial": self.start, "scans": len(self.rows),
                "ends_at_s": self.ends_at_ns / 1e9, "rows": rows,
                "repeats_from_scan": self.repeats_from, "fault": self.fault,
                "remark": self.remark}

    def lines(self) -> list[str]:
        """Return it as text, a line for each scan that changed something."""
        text = [f"  from a cold start, {self.start}:"]
        for row in self.rows:
            if row.scan == self.repeats_from:
                stays = row is self.rows[-1]
                rest = "happens" if self.may_go_on else "can happen"
                text.append(f"  from here on nothing {rest} any more:" if stays else
                            "  from here on again and again:")
            if row.action:
                at = "" if self.times is None else f" (at {format_duration(self.at_ns(row.scan))})"
                text.append(f"  {'':>6}  {row.action}{at}")
            if row.changes:
                told = ", ".join(f"{_short(tag)} = {_shown(value)}"
                                 for tag, value in row.changes.items())
                text.append(f"  {row.scan:>6}  {told}")
        if self.decided_ns:
            at = format_duration(self.ends_at_ns)
            text.append(f"  {'':>6}  violated at {at}, as time passes")
        if self.remark:
            text.append(f"  {self.remark}")
        if self.fault:
            text.append(f"  {'':>6}  FAULT: {self.fault}")
        return text

    @property
    def ends_at_ns(self) -> int:
        """The instant at which a violation that takes no run without end is decided."""
        return self.at_ns(len(self.rows) - 1) + self.decided_ns

    def played(self, rounds: int = 1) -> list[Row]:
        """Return the scans with what is repeated for ever played a number of times."""
        if self.repeats_from is None or self.repeats_from == len(self.rows) - 1:
            return self.rows
        return [*self.rows, *(rounds - 1) * self.rows[self.repeats_from:]]

    def scenario(self, description: str, points: Sequence[Point], facts: Collection[str] = (),
                 rounds: int = 1) -> str:
        """Return the inputs as a scenario file, which `simulate --no-plant` plays.

        Args:
            description: what the file says of itself.
            points: where the inputs stand.
            facts: the plant's facts that are told besides.
            rounds: how often what is repeated for ever is played.
        """
        lines = [f"description: {json.dumps(description)}", "steps:"]
        told = [(n, tag.name) for n, tag in enumerate(self.predicates.tags) if tag.name in facts]
        before: dict[str, Value] = {}
        for scan, row in enumerate(self.played(rounds)):
            now: dict[str, Value] = {str(p.address): _written(p, row.inputs[p.name])
                                     for p in points}
            now |= {name: row.values[n] for n, name in told}
            values = ", ".join(f'"{name}": {json.dumps(v)}' for name, v in now.items()
                               if v != before.get(name))
            before = now
            if values:
                note = f"  # {row.action}" if row.action else ""
                lines.append(f"  - {{t_ns: {self.at_ns(scan)}, set: {{{values}}}}}{note}")
        return "\n".join(lines) + "\n"

    def trace(self) -> Trace:
        """Return it as a trace with one frame a scan; the first one holds every tag."""
        trace = Trace(self.predicates.tags)
        before: Sequence[Value] = ()
        for row in self.rows:
            changes: tuple[Change, ...] = tuple(
                (i, v) for i, v in enumerate(row.values) if not before or before[i] != v)
            trace.observe(Frame(self.at_ns(row.scan), row.scan, changes))
            before = row.values
        trace.end_ns = self.ends_at_ns
        return trace


def _written(point: Point, raw: int) -> Value:
    """Return what is written to an input so that it reads a raw value."""
    value = replace(point, scale=Fraction(1)).to_value(raw)
    return value if isinstance(value, bool) else round(value)


def _short(tag: str) -> str:
    """Return a tag without its program's name, as properties write it."""
    return tag if tag.startswith("plant.") else tag.partition(".")[2] or tag


def _shown(value: Value) -> str:
    return str(value).upper() if isinstance(value, bool) else str(value)


def path_of(loop: ClosedLoop, graph: StateGraph, predicates: Predicates, run: Lasso,
            watched: int | None, cycle_ns: int,
            decided: tuple[int | None, int] | None = None) -> Path:
    """Return a run as a path, executing its scans again.

    Args:
        loop: the closed loop.
        graph: in which the run's states are numbered.
        predicates: knows the tags.
        run: what to show.
        watched: the path ends in the scan of its last step in which this watched formula holds.
        cycle_ns: the time between two scans.
        decided: or it ends with this number of scans of its last step, so many ns after the last.
    """
    origin = loop.origins[graph.states[run.start]] if run.origin is None else run.origin
    writer = _Writer(loop, predicates)
    writer.take("", loop.first_scans(origin)[0])
    here = run.start
    for step in run.stem:
        here = writer.step(graph, here, step)
    fault = graph.states[here].fault
    repeats = None
    if watched is not None:
        writer.cut(watched)
    elif decided is not None:
        writer.keep(decided[0])
    elif not fault:
        repeats = len(writer.rows) if run.cycle else len(writer.rows) - 1
        for step in run.cycle:
            here = writer.step(graph, here, step)
    return Path(loop.plant.name_of(origin), writer.rows, repeats, "" if decided else fault,
                cycle_ns, predicates, decided[1] if decided else 0,
                may_go_on=bool(loop.actions(graph.states[here])))


class _Writer:
    """Collects rows."""

    def __init__(self, loop: ClosedLoop, predicates: Predicates) -> None:
        self.loop, self.predicates = loop, predicates
        self.rows: list[Row] = []
        self.before: tuple[Value, ...] = ()
        self.last: list[tuple[bytes, Hashable]] = []

    def step(self, graph: StateGraph, source: int, step: Step) -> int:
        # What was cut away from the state goes on from what it was.
        state = graph.states[source]._replace(memory=self.last[-1][0])
        scans = self.loop.scans(state, step.action)[0]
        self.take(str(step.action), scans)
        return step.target

    def take(self, action: str, scans: list[tuple[bytes, Hashable]]) -> None:
        self.last = scans
        for n, (memory, plant) in enumerate(scans):
            values = tuple(self.predicates.values(memory, self.loop.facts(plant)))
            self.rows.append(row_of(len(self.rows), action if n == 0 else "", self.predicates,
                                    values, self.before, self.loop.raw_inputs(plant)))
            self.before = values

    def cut(self, watched: int) -> None:
        """Drop the scans of the last step after the first one in which a formula holds."""
        for n, (memory, plant) in enumerate(self.last):
            if self.loop.watch(memory, self.loop.facts(plant)) >> watched & 1:
                self.keep(n + 1)
                return

    def keep(self, scans: int | None) -> None:
        """Keep so many scans of the last step; all if None."""
        if scans is not None:
            del self.rows[len(self.rows) - len(self.last) + scans:]


def row_of(scan: int, action: str, predicates: Predicates, values: tuple[Value, ...],
           before: tuple[Value, ...], inputs: dict[str, int]) -> Row:
    """Return the row of a scan from the values of all tags after it and after the one before."""
    changes = {tag.name: now for tag, now, old in
               zip(predicates.tags, values, before or _initial(values), strict=True)
               if tag.type != "TIME" and now != old}
    return Row(scan, action, changes, inputs, values)


def _initial(values: tuple[Value, ...]) -> tuple[Value, ...]:
    """What counts as unchanged in the first scan: FALSE, 0 and empty texts."""
    return tuple(type(value)() for value in values)
