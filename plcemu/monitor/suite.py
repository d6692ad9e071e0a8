"""Properties judged together over one stream of frames, online or from a recording."""

from __future__ import annotations

import copy
from collections.abc import Collection, Iterable

from plcemu.base.errors import CompileError
from plcemu.base.spans import Diagnostic
from plcemu.base.tags import TagTable
from plcemu.base.trace import Frame, Trace
from plcemu.base.types import Value
from plcemu.monitor.bind import Binder
from plcemu.monitor.formula import Formula
from plcemu.monitor.linear import on_one_run
from plcemu.monitor.parse import Property, parse_formula
from plcemu.monitor.verdict import Result, Verdict
from plcemu.monitor.watch import Watch


class Suite:
    """An observer that judges properties while frames come.

    Monitoring starts at the first frame, which must give every tag a value. A frame tells what
    changed at its instant; `advance` tells that nothing else changed up to and with an instant.
    Each property is looked at only when one of its tags changes or its deadline has passed.

    Args:
        properties: what is demanded.
        tags: the tag table that the frames' changes refer to.

    Raises:
        CompileError: a property names no tag, mixes up types, or cannot be judged on one run;
            with every mistake found.
    """

    def __init__(self, properties: Iterable[Property], tags: TagTable) -> None:
        self._watches = _watches(properties, tags)
        self._open = list(self._watches)
        self._now: list[Value | None] = [None] * len(tags)
        self._before: list[Value | None] = []
        self._t_ns: int | None = None
        self._deadline_ns: int | None = None
        self._masks: list[int] = []
        self._touched: dict[int, tuple[Watch, ...]] = {}
        self._index()

    def observe(self, frame: Frame) -> None:
        """Take one frame.

        Raises:
            ValueError: its instant is not after the last one.
        """
        t_ns = frame.t_ns
        if self._t_ns is None:
            self._start(frame)
            return
        if t_ns <= self._t_ns:
            raise ValueError(f"the frame at {t_ns} ns comes after {self._t_ns} ns was passed")
        if self._deadline_ns is not None and self._deadline_ns < t_ns:
            self._expire(t_ns - 1)
        self._t_ns = t_ns
        changes = frame.changes
        if changes:
            now, masks, touched = self._now, self._masks, 0
            for index, value in changes:
                now[index] = value
                touched |= masks[index]
            if touched:
                self._step(frame, touched)
            before = self._before
            for index, value in changes:
                before[index] = value
        if self._deadline_ns is not None and self._deadline_ns <= t_ns:
            self._expire(t_ns)

    def advance(self, t_ns: int) -> None:
        """Take it that nothing changed since the last frame up to and with the instant `t_ns`.

        Time that has passed already, and time before the first frame, says nothing new.
        """
        if self._t_ns is None or t_ns <= self._t_ns:
            return
        if self._deadline_ns is not None and self._deadline_ns <= t_ns:
            self._expire(t_ns)
        self._t_ns = t_ns

    def finish(self, t_ns: int) -> list[Result]:
        """Cut the run after the instant `t_ns`, and return how every property stands."""
        self.advance(t_ns)
        return self.results()

    def copy(self) -> Suite:
        """Return an independent suite in the same state."""
        fixed = [part for watch in self._watches for part in watch.fixed]
        return copy.deepcopy(self, {id(part): part for part in fixed})

    def next_deadline_ns(self) -> int | None:
        """Return the first instant at which a verdict falls if nothing changes, in ns."""
        return self._deadline_ns

    @property
    def undecided(self) -> int:
        """How many properties have no final verdict yet."""
        return len(self._open)

    def verdicts(self) -> list[Verdict]:
        """Return the verdicts alone, in the order the properties were given."""
        return [watch.stands(self._t_ns) for watch in self._watches]

    def results(self) -> list[Result]:
        """Return how every property stands now, in the order they were given."""
        return [watch.result(self._t_ns) for watch in self._watches]

    def keep_only(self, names: Collection[str]) -> None:
        """Judge the properties of these names alone from now on."""
        self._watches = [watch for watch in self._watches if watch.entry.name in names]
        self._open = [watch for watch in self._open if watch.entry.name in names]
        self._settle()
        self._index()

    def tags_used(self, name: str | None = None) -> set[int]:
        """Return the indices of the tags that a property names, or all properties."""
        return {index for watch in self._watches if name in (None, watch.entry.name)
                for index in watch.tags_used}

    def value(self, index: int) -> Value | None:
        """Return a tag's value as of the last frame; None before the first."""
        return self._now[index]

    def _start(self, frame: Frame) -> None:
        self._t_ns = frame.t_ns
        for index, value in frame.changes:
            self._now[index] = value
        self._before = list(self._now)
        for watch in self._open:
            watch.start(frame, self._now)
        self._settle()

    def _step(self, frame: Frame, touched: int) -> None:
        watches = self._touched.get(touched)
        if watches is None:
            watches = tuple(w for i, w in enumerate(self._open) if touched >> i & 1)
            self._touched[touched] = watches
        now, before = self._now, self._before
        for watch in watches:
            watch.step(frame, now, before)
        self._settle()

    def _expire(self, t_ns: int) -> None:
        for watch in self._open:
            if watch.deadline_ns is not None and watch.deadline_ns <= t_ns:
                watch.expire(self._now)
        self._settle()

    def _settle(self) -> None:
        """Drop decided properties, and find the next deadline."""
        deadline, decided = None, False
        for watch in self._open:
            at = watch.deadline_ns
            if at is not None and (deadline is None or at < deadline):
                deadline = at
            if watch.verdict is not None:
                decided = True
        self._deadline_ns = deadline
        if decided:
            self._open = [watch for watch in self._open if watch.verdict is None]
            self._index()

    def _index(self) -> None:
        """Note for each tag, as a bit mask, which open properties look at it."""
        self._masks = [0] * len(self._now)
        self._touched.clear()
        for i, watch in enumerate(self._open):
            for index in watch.tags_used:
                self._masks[index] |= 1 << i


def _watches(properties: Iterable[Property], tags: TagTable) -> list[Watch]:
    """Bind properties to tags; every mistake in any of them is reported at once."""
    watches, mistakes = [], []
    for entry in properties:
        found: list[Diagnostic] = []
        formula = on_one_run(entry.formula, found)
        binder = Binder(tags, found)
        used = binder.check(formula)
        if found:
            mistakes += found
        else:
            watches.append(Watch(entry, formula, used, binder))
    if mistakes:
        raise CompileError(mistakes)
    return watches


class Monitor:
    """One formula, ready to judge any trace that has its tags.

    Raises:
        CompileError: the text is no formula.
    """

    def __init__(self, formula: str | Formula | Property, name: str = "property") -> None:
        if isinstance(formula, Property):
            self.entry = formula
        else:
            tree = parse_formula(formula) if isinstance(formula, str) else formula
            self.entry = Property(name, tree)

    def check(self, trace: Trace) -> Result:
        """Judge a recorded run up to its end.

        Raises:
            CompileError: the formula does not fit the trace's tags, or one run cannot judge it.
        """
        return judge(trace, [self.entry])[0]


def judge(trace: Trace, properties: Iterable[Property]) -> list[Result]:
    """Judge a recorded run up to its end.

    Raises:
        CompileError: a property does not fit the trace's tags, or one run cannot judge it.
    """
    suite = Suite(properties, trace.tags)
    for frame in trace.frames:
        suite.observe(frame)
    return suite.finish(trace.end_ns)
