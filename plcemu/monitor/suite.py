"""Properties judged together over one stream of frames, online or from a recording."""

from __future__ import annotations

import copy
from collections.abc import Collection, Iterable

from plcemu.base.errors import CompileError
from plcemu.base.spans import Diagnostic
from plcemu.base.tags import TagTable
from plcemu.base.trace import Change, Frame, Trace
from plcemu.base.types import Value
from plcemu.monitor.bind import Binder, Delay
from plcemu.monitor.delays import DelayLines
from plcemu.monitor.formula import Formula
from plcemu.monitor.linear import on_one_run
from plcemu.monitor.parse import Property, parse_property
from plcemu.monitor.verdict import Result, Verdict
from plcemu.monitor.watch import Watch

EXCERPT = 50
"""The number of frames before a violation that its excerpt holds."""


class Suite:
    """An observer that judges properties while frames come.

    Monitoring starts at the first frame. A frame tells what changed at its instant; `advance`
    tells that nothing else changed up to and with an instant. Each property is looked at only
    when one of its tags changes or its deadline has passed: a frame that changes nothing costs a
    comparison or two. A change to None says that a tag's value is not known (bad quality) until
    its next change.

    Args:
        properties: what is demanded.
        tags: the tag table that the frames' changes refer to.

    Raises:
        CompileError: a property names no tag, mixes up types, or cannot be judged on one run;
            with every mistake found.

    Attributes:
        undecided: how many properties have no final verdict yet.
    """

    def __init__(self, properties: Iterable[Property], tags: TagTable) -> None:
        self._tags = tags
        self._watches, delays = _watches(properties, tags)
        self._lines = DelayLines(delays) if delays else None
        self._sources = {delay.slot: delay.source for delay in delays}
        self._open = list(self._watches)
        self._now: list[Value | None] = [None] * (len(tags) + len(delays))
        self._before: list[Value | None] = []
        self._t_ns: int | None = None
        self._scan = 0
        self._wake_ns: int | None = None
        self._unsure = False
        self._masks: list[int] = []
        self._touched: dict[int, tuple[Watch, ...]] = {}
        # Whether a value that is read is not known, or delayed ones are read: the longer way.
        self._special = True
        self._read: tuple[int, ...] = ()
        self._frames: list[Frame] = []
        self._past: list[Value | None] = []
        self._older: tuple[list[Value | None], list[Frame]] = ([], [])
        self._exact = False
        # Which open properties may stand otherwise than `_verdicts` says, as bit masks.
        self._moved = self._restless = 0
        self._standing = [Verdict.INCONCLUSIVE] * len(self._watches)
        self._verdicts = [Verdict.INCONCLUSIVE.value] * len(self._watches)
        # Which open properties are told of every scan, also of one that changed nothing.
        self._every = 0
        self._index()

    def observe(self, frame: Frame) -> None:
        """Take one frame.

        Raises:
            ValueError: its instant is not after the last one.
        """
        t_ns = frame.t_ns
        last_ns = self._t_ns
        if last_ns is None:
            self._start(frame)
            return
        if t_ns <= last_ns:
            raise ValueError(f"the frame at {t_ns} ns comes after {last_ns} ns was passed")
        wake_ns = self._wake_ns
        if wake_ns is not None and wake_ns < t_ns:
            self._pass(t_ns - 1)
        self._t_ns = t_ns
        changes = frame.changes
        if changes:
            self._frames.append(frame)
            if self._special:
                self._change(frame)
            else:
                now, before, masks, touched = self._now, self._before, self._masks, 0
                for index, value in changes:
                    now[index] = value
                    touched |= masks[index]
                    if value is None:
                        self._unsure = self._special = True
                if touched:
                    self._step(frame, touched)
                for index, value in changes:
                    before[index] = value
            if len(self._frames) >= EXCERPT:
                self._turn()
        elif self._every:
            self._step(frame, self._every)
        elif wake_ns is None:
            return
        if self._wake_ns is not None and self._wake_ns <= t_ns:
            self._pass(t_ns)

    def advance(self, t_ns: int) -> None:
        """Take it that nothing changed since the last frame up to and with the instant `t_ns`.

        Time that has passed already, and time before the first frame, says nothing new.
        """
        if self._t_ns is None or t_ns <= self._t_ns:
            return
        if self._wake_ns is not None and self._wake_ns <= t_ns:
            self._pass(t_ns)
        self._t_ns = t_ns

    def finish(self, t_ns: int) -> list[Result]:
        """Cut the run after the instant `t_ns`, and return how every property stands."""
        self.advance(t_ns)
        return self.results()

    def copy(self) -> Suite:
        """Return an independent suite in the same state."""
        fixed: list[object] = [self._tags, *self._frames, *self._older[1]]
        fixed += [part for watch in self._watches for part in watch.fixed]
        return copy.deepcopy(self, {id(part): part for part in fixed})

    def next_deadline_ns(self) -> int | None:
        """Return the first instant at which a verdict falls if nothing changes, in ns.

        With `ago` it may be the earlier instant at which a past change comes to be seen.
        """
        if not self._exact:
            for watch in self._open:
                if watch.deadline_ns is not None:
                    watch.exact_deadline_ns()
            self._set_wake()
            self._exact = True
        return self._wake_ns

    def verdicts(self) -> list[str]:
        """Return the verdicts alone, in the order the properties were given.

        As long as none of them changes it is the same list; only what was looked at since the
        last call, or moves with time, is asked again.
        """
        moved, self._moved = self._moved | self._restless, 0
        told = True
        while moved:
            watch = self._open[moved.bit_length() - 1]
            moved ^= 1 << moved.bit_length() - 1
            verdict = watch.stands(self._t_ns)
            if verdict is not self._standing[watch.place]:
                self._standing[watch.place] = verdict
                told = False
        if not told:
            self._verdicts = [verdict.value for verdict in self._standing]
        return self._verdicts

    def results(self) -> list[Result]:
        """Return how every property stands now, in the order they were given."""
        return [watch.result(self._t_ns) for watch in self._watches]

    def keep_only(self, names: Collection[str]) -> None:
        """Judge the properties of these names alone from now on."""
        self._watches = [watch for watch in self._watches if watch.entry.name in names]
        self._open = [watch for watch in self._open if watch.entry.name in names]
        self._standing = [self._standing[watch.place] for watch in self._watches]
        self._verdicts = [verdict.value for verdict in self._standing]
        for place, watch in enumerate(self._watches):
            watch.place = place
        self._settle()
        self._index()

    def tags_used(self, name: str | None = None) -> set[int]:
        """Return the indices of the tags that a property names, or all properties."""
        return {self._sources.get(index, index) for watch in self._watches
                if name in (None, watch.entry.name) for index in watch.tags_used}

    def value(self, index: int) -> Value | None:
        """Return a tag's value as of the last frame; None before the first."""
        return self._now[index]

    # ------------------------------------------------------------ changes

    def _start(self, frame: Frame) -> None:
        self._t_ns = frame.t_ns
        now = self._now
        for index, value in frame.changes:
            now[index] = value
        if self._lines is not None:
            self._lines.start(now)
        self._before, self._past = list(now), list(now)
        self._frames.append(frame)
        self._unsure = True
        for watch in self._open:
            watch.step(frame, now, now, self._sure(watch))
        self._weigh()
        self._settle()
        if self._wake_ns is not None and self._wake_ns <= frame.t_ns:
            self._pass(frame.t_ns)

    def _change(self, frame: Frame) -> None:
        """Take what changed at an instant, delayed changes that come to be seen then included."""
        lines = self._lines
        self._scan = frame.scan
        if lines is not None:
            frame = lines.joined(frame)
        changes = frame.changes
        now, before, masks, touched = self._now, self._before, self._masks, 0
        for index, value in changes:
            now[index] = value
            touched |= masks[index]
            if value is None:
                self._unsure = True
        if touched:
            self._step(frame, touched)
        for index, value in changes:
            before[index] = value
        if self._unsure:
            self._weigh()
        if lines is not None:
            for slot in lines.feed(frame):
                self._give_up(slot, frame.t_ns)
            self._set_wake()

    def _weigh(self) -> None:
        """Find out whether some value that is read is not known."""
        now = self._now
        self._unsure = any(now[index] is None for index in self._read)
        self._special = self._unsure or self._lines is not None

    def _step(self, frame: Frame, touched: int) -> None:
        watches = self._touched.get(touched)
        if watches is None:
            watches = tuple(w for i, w in enumerate(self._open) if touched >> i & 1)
            self._touched[touched] = watches
        self._moved |= touched
        now, before, moved = self._now, self._before, False
        if self._unsure:
            for watch in watches:
                moved |= watch.step(frame, now, before, self._sure(watch))
        else:
            for watch in watches:
                moved |= watch.step(frame, now, before, True)
        if moved:
            self._settle()

    def _sure(self, watch: Watch) -> bool:
        """Tell whether all values that a property reads are known, now and just before."""
        now, before = self._now, self._before
        return all(now[i] is not None and before[i] is not None for i in watch.tags_used)

    # ------------------------------------------------------------ time

    def _pass(self, t_ns: int) -> None:
        """Let time pass up to and with an instant without a frame."""
        lines = self._lines
        while lines is not None and lines.next_ns is not None and lines.next_ns <= t_ns:
            due_ns = lines.next_ns
            self._lapse(due_ns - 1)
            self._change(Frame(due_ns, self._scan, ()))
        self._lapse(t_ns)

    def _lapse(self, t_ns: int) -> None:
        for watch in self._open:
            while watch.deadline_ns is not None and watch.deadline_ns <= t_ns:
                watch.lapse(t_ns, self._now)
        self._moved = (1 << len(self._open)) - 1
        self._settle()

    def _give_up(self, slot: int, t_ns: int) -> None:
        for watch in self._open:
            if slot in watch.tags_used:
                watch.give_up(t_ns, "too many changes wait in ago; shorten its duration")
        self._settle()

    def _set_wake(self) -> None:
        """Find the next instant at which to look without a change."""
        wake = self._lines.next_ns if self._lines is not None else None
        for watch in self._open:
            at = watch.deadline_ns
            if at is not None and (wake is None or at < wake):
                wake = at
        self._wake_ns, self._exact = wake, False

    def _settle(self) -> None:
        """Drop decided properties, and find the next instant at which to look."""
        decided = [watch for watch in self._open if watch.verdict is not None]
        for watch in decided:
            watch.tell(self._excerpt)
        if decided:
            for watch in decided:
                assert watch.verdict is not None
                self._standing[watch.place] = watch.verdict
            self._verdicts = [verdict.value for verdict in self._standing]
            self._open = [watch for watch in self._open if watch.verdict is None]
            self._index()
        self._set_wake()

    def _index(self) -> None:
        """Note for each tag, as a bit mask, which open properties look at it."""
        every = sum(1 << i for i, watch in enumerate(self._open) if watch.every_frame)
        self._every = every
        self._masks = [every] * len(self._now)
        self._read = tuple({index for watch in self._open for index in watch.tags_used})
        self._touched.clear()
        self.undecided = len(self._open)
        self._moved = (1 << len(self._open)) - 1
        self._restless = sum(1 << i for i, watch in enumerate(self._open) if watch.restless)
        for i, watch in enumerate(self._open):
            for index in watch.tags_used:
                self._masks[index] |= 1 << i

    # ------------------------------------------------------------ the last frames

    def _turn(self) -> None:
        """Begin a new list of frames; the last one is kept with the values before it."""
        self._older = (self._past, self._frames)
        self._past, self._frames = list(self._now), []

    def _excerpt(self, end_ns: int) -> Trace:
        """Return the last frames up to an instant as a trace; its first frame is complete."""
        past, older = self._older
        recent = [frame for frame in (*older, *self._frames) if frame.t_ns <= end_ns]
        skipped, frames = recent[:-EXCERPT], recent[-EXCERPT:]
        values = list(past if older else self._past)[:len(self._tags)]
        for frame in (*skipped, frames[0]):
            for index, value in frame.changes:
                values[index] = value
        whole: tuple[Change, ...] = tuple((i, v) for i, v in enumerate(values) if v is not None)
        first = Frame(frames[0].t_ns, frames[0].scan, whole)
        return Trace(self._tags, [first, *frames[1:]], end_ns)


def _watches(properties: Iterable[Property], tags: TagTable) -> tuple[list[Watch], list[Delay]]:
    """Bind properties to tags; every mistake in any of them is reported at once."""
    watches: list[Watch] = []
    mistakes: list[Diagnostic] = []
    delays: dict[tuple[int, int], Delay] = {}
    for entry in properties:
        found: list[Diagnostic] = []
        binder = Binder(tags, found, delays)
        formula = binder.check(on_one_run(entry.formula, found))
        if found:
            mistakes += found
        else:
            watches.append(Watch(entry, formula, binder, len(watches)))
    if mistakes:
        raise CompileError(mistakes)
    return watches, list(delays.values())


class Monitor:
    """One formula, ready to judge any trace that has its tags.

    Raises:
        CompileError: the text is no formula.
    """

    def __init__(self, formula: str | Formula | Property, name: str = "property") -> None:
        if isinstance(formula, Property):
            self.entry = formula
        else:
            self.entry = parse_property(formula, name) if isinstance(formula, str) \
                else Property(name, formula)

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
