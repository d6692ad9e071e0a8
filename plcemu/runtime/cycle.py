"""The cycle: one lap after another, in one direction (docs/timing.md numbers its phases).

    1 latch inputs  2 scan due tasks  3 publish outputs  4 frame to observers  5 plant  6 sleep

The same loop runs in real and in virtual time; only the clock differs.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import accumulate, compress
from operator import ne
from typing import Protocol

from plcemu.base.errors import PlcemuError
from plcemu.base.tags import TagTable
from plcemu.base.time import Clock
from plcemu.base.trace import Change, Frame, Observer
from plcemu.base.types import Value
from plcemu.engine.resource import Checkpoint as ResourceCheckpoint
from plcemu.engine.resource import Resource
from plcemu.io.exchange import Checkpoint as ExchangeCheckpoint
from plcemu.io.exchange import Exchange
from plcemu.monitor.parse import Property
from plcemu.monitor.suites import Succession, Suites
from plcemu.runtime.local_plant import Checkpoint as PlantCheckpoint
from plcemu.runtime.local_plant import LocalPlant
from plcemu.runtime.reactions import Checkpoint as ReactionsCheckpoint
from plcemu.runtime.reactions import Reactions
from plcemu.runtime.status import CycleCounters, Source, StateTags, TaskTags, VerdictTags


class Stimulus(Protocol):
    """Writes from outside at set instants; `played` of them have been made."""

    played: int

    def before_scan(self, t_ns: int) -> None:
        """Queue what is due at a lap."""

    def next_event_ns(self) -> int | None:
        """Return when the next write is due, if there is one."""


class Recorder(Protocol):
    """Who is asked before and after every lap; it only looks."""

    def before_lap(self) -> None:
        """The writes for the lap wait; nothing has been latched."""

    def after_lap(self) -> None:
        """The lap is over, and the next release is known."""


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """The whole state of a cycle between two laps, but for the writes of clients that wait.

    Attributes:
        place: `t_ns`, `now_ns` and `scan_number` of the cycle.
        shown: what the last frame told: memory, then the other tags by source; None before it.
        counters: the attributes of the counters that are numbers.
        scans: how many each task has made.
        times: the times of steps that only properties read, and whether they ran.
        played: how many steps of the scenario have been played.
        suite: the monitors.
    """

    place: tuple[int, int, int]
    shown: tuple[bytes, tuple[tuple[Value | None, ...], ...]] | None
    times: tuple[tuple[Value, ...], bool]
    counters: dict[str, int]
    scans: tuple[int, ...]
    resource: ResourceCheckpoint
    exchange: ExchangeCheckpoint
    plant: PlantCheckpoint | None
    played: int
    suite: Suites
    reactions: ReactionsCheckpoint | None = None


@dataclass(frozen=True, slots=True)
class Replacement:
    """Another resource for a cycle, with the tags and monitors that belong to it."""

    resource: Resource
    own: _OwnTags
    succession: Succession


@dataclass(frozen=True, slots=True)
class _OwnTags:
    """The sources of tags beside memory: the verdicts are the last one."""

    sources: tuple[Source, ...]
    tasks: TaskTags
    verdicts: VerdictTags

    @property
    def every(self) -> tuple[Source, ...]:
        return (*self.sources, self.verdicts)


class Cycle:
    """Runs a resource lap by lap.

    Args:
        resource: with its program.
        exchange: over the resource's memory.
        plant: a plant in this process, or None.
        properties: judged while it runs.
        sources: of further tags.

    Raises:
        CompileError: a property does not fit the tags.
        PlcemuError: two tags have one name.

    Attributes:
        player: of a scenario, or None.
        t_ns: the next release.
        now_ns: how far the run has come.
        scan_number: of the next scan.
        observers: are shown every frame.
        state_observers: are shown every frame without the elapsed times that the program does not
            read. For their sake alone no scan is executed that changes nothing else.
    """

    def __init__(self, resource: Resource, exchange: Exchange, plant: LocalPlant | None = None,
                 properties: Sequence[Property] = (), sources: Sequence[Source] = ()) -> None:
        self.resource = resource
        self.exchange = exchange
        self.plant = plant
        self.player: Stimulus | None = None
        self.counters = CycleCounters()
        self.t_ns = resource.first_release_ns(0)
        self.now_ns = 0
        self.scan_number = 0
        self.observers: list[Observer] = []
        self.state_observers: list[Observer] = []
        self.recorder: Recorder | None = None
        self.reactions: Reactions | None = None
        self._further = tuple(sources)
        self._own = self._own_tags(resource, properties)
        self.tags = _all_tags(resource, self._own.every)
        self.suite = Suites(properties, self.tags)
        self._in_lap = False
        self._commands: list[Callable[[], None]] = []
        self._begin()

    def _own_tags(self, resource: Resource, properties: Sequence[Property]) -> _OwnTags:
        tasks = TaskTags(resource)
        sources = (self.plant, self.counters, StateTags(resource), tasks, *self._further)
        return _OwnTags(tuple(s for s in sources if s is not None), tasks, VerdictTags(properties))

    def _begin(self) -> None:
        """Let the next frame be one that holds every tag."""
        every = self._own.every
        self._ask = [source.values for source in self._own.sources]
        self._last: list[Sequence[Value | None]] = [() for _ in every]
        self._bases = list(accumulate([len(self.resource.memory.tags),
                                       *(len(s.tags) for s in every)]))
        self._own.verdicts.suite = self.suite
        self._started = False
        self._times_run = False
        memory = self.resource.memory
        self._elapsed_judged = not memory.elapsed_tags.isdisjoint(self.suite.reads)
        # Times of steps that only properties read: no part of what the program's frames show.
        self._judged_times = sorted(self.suite.reads & memory.idle_tags)
        self._times: list[Value] = [memory.read(i) for i in self._judged_times]

    # ------------------------------------------------------------ an edited program

    def plan(self, resource: Resource, properties: Sequence[Property]) -> Replacement:
        """Find out whether tags and properties fit another resource; nothing changes yet.

        Raises:
            CompileError: a property does not fit the new tags.
            PlcemuError: two tags have one name.
        """
        own = self._own_tags(resource, properties)
        tags = _all_tags(resource, own.every)
        return Replacement(resource, own, self.suite.plan(properties, tags))

    def replace(self, plan: Replacement) -> None:
        """Go on with another resource from the next release on; the next frame is a whole one."""
        self.resource, self._own = plan.resource, plan.own
        self.suite.follow(plan.succession)
        self.tags = plan.succession.tags
        self._begin()
        self.t_ns = max(self.t_ns, plan.resource.first_release_ns(self.t_ns))

    @property
    def end_ns(self) -> int:
        """The last instant of which the run tells: the next release may change anything."""
        return max(0, min(self.now_ns, self.t_ns - 1))

    def values(self) -> list[Value | None]:
        """Return the present values of all tags, in their order."""
        memory = self.resource.memory
        shown = [self._own.tasks.present() if s is self._own.tasks else s.values()
                 for s in self._own.every]
        return [*(memory.read(i) for i in range(len(memory.tags))),
                *(value for values in shown for value in values)]

    # ------------------------------------------------------------ commands

    def stop(self) -> None:
        """Go to STOP at the next scan boundary: nothing runs, outputs take their safe values."""
        self._at_boundary(self.resource.stop)

    def resume(self) -> None:
        """Go from STOP or FAULT to RUN at the next scan boundary, with memory as it is.

        Raises:
            InterlockError: a reaction stopped the PLC, and its alarm is not acknowledged.
        """
        self._check_may_run()
        self._at_boundary(self.resource.resume)

    def restart(self, cold: bool) -> None:
        """Begin anew at the next scan boundary, from any state; the scan then is a first scan.

        Args:
            cold: whether retained variables get their initial values too.

        Raises:
            InterlockError: a reaction stopped the PLC, and its alarm is not acknowledged.
        """
        self._check_may_run()
        self._at_boundary(lambda: self.resource.restart(cold))

    def _check_may_run(self) -> None:
        if self.reactions is not None:
            self.reactions.check_may_run()

    def judge_anew(self, name: str) -> None:
        """Judge a property from now on as if the run began here, with the present values."""
        frame = Frame(self.end_ns, max(0, self.scan_number - 1), tuple(enumerate(self.values())))
        self.suite.restart(name, frame)

    def _at_boundary(self, command: Callable[[], None]) -> None:
        """Carry a command out between two laps: now, or when the lap under way has ended."""
        self._commands.append(command)
        if not self._in_lap:
            self._obey()

    def _obey(self) -> None:
        waiting, self._commands = self._commands, []
        for command in waiting:
            command()
        self.exchange.update_outputs()

    # ------------------------------------------------------------ one lap

    def lap(self, now_ns: Callable[[], int] | None = None) -> None:
        """Execute the lap at `t_ns`, then let `t_ns` be the next release.

        Args:
            now_ns: the clock, in real time; None in virtual time.
        """
        self._in_lap = True
        try:
            self._phases(now_ns)
        finally:
            self._in_lap = False
        if self._commands:
            self._obey()

    def _phases(self, now_ns: Callable[[], int] | None) -> None:
        t_ns = self.t_ns
        if self.recorder is not None:
            self.recorder.before_lap()
        if self.plant is not None:
            self.plant.before_scan(t_ns)
        if self.player is not None:
            self.player.before_scan(t_ns)
        self.exchange.update_inputs()
        self.resource.scan(t_ns, now_ns)
        self.exchange.update_outputs()
        self._show(t_ns)
        if self.reactions is not None and self._commands:
            self._obey()  # a stop: not even the plant sees what this scan put out
        if self.plant is not None:
            self.plant.after_scan()
        self.counters.laps += 1
        self.scan_number += 1
        self.now_ns = self.t_ns = self.resource.first_release_ns(t_ns + 1)
        if self.recorder is not None:
            self.recorder.after_lap()

    def _show(self, t_ns: int) -> None:
        """Make the frame of this lap; the monitors judge it first, their verdicts join it."""
        first = not self._started
        changes = self._changes()
        frame = Frame(t_ns, self.scan_number, changes)
        undecided = self.suite.undecided
        self.suite.observe(frame)
        if self.reactions is not None:
            self.reactions.after_judging(t_ns)
        if changes or self.suite.undecided != undecided:
            verdicts = self._own.verdicts.values()
            if verdicts is not self._last[-1]:
                moved = self._moved(len(self._last) - 1, verdicts)
                frame = Frame(t_ns, self.scan_number, (*changes, *moved))
        for observer in self.observers:
            observer.observe(frame)
        if self.state_observers:
            unread = self.resource.memory.elapsed_tags
            if unread and not first:
                frame = Frame(t_ns, self.scan_number,
                              tuple(c for c in frame.changes if c[0] not in unread))
            for observer in self.state_observers:
                observer.observe(frame)

    def _changes(self) -> tuple[Change, ...]:
        """Return what has changed, all in the first frame, without the verdicts."""
        memory = self.resource.memory
        changes = list(memory.changes() if self._started else memory.values())
        self._started = True
        if self._judged_times:
            now = [memory.read(i) for i in self._judged_times]
            told = {index for index, _ in changes}
            changes += [(i, new) for i, new, old in
                        zip(self._judged_times, now, self._times, strict=True)
                        if new != old and i not in told]
            self._times_run, self._times = now != self._times, now
        last = self._last
        for n, ask in enumerate(self._ask):
            values = ask()
            if values is not last[n]:
                changes += self._moved(n, values)
        return tuple(changes)

    def _moved(self, n: int, now: Sequence[Value | None]) -> list[Change]:
        """Return the changed values of the source number `n`; the verdicts are the last one."""
        before, base = self._last[n], self._bases[n]
        self._last[n] = now
        return list(compress(enumerate(now, base), map(ne, now, before)) if before
                    else enumerate(now, base))

    # ------------------------------------------------------------ checkpoints

    def checkpoint(self) -> Checkpoint:
        """Return the whole state, but for the writes of clients that wait."""
        memory = self.resource.memory
        shown = (memory.shown, tuple(tuple(v) for v in self._last)) if self._started else None
        return Checkpoint(
            (self.t_ns, self.now_ns, self.scan_number), shown,
            (tuple(self._times), self._times_run), self.counters.numbers(),
            tuple(each.scans for each in self.resource.statistics), self.resource.checkpoint(),
            self.exchange.checkpoint(),
            self.plant.checkpoint() if self.plant is not None else None,
            self.player.played if self.player is not None else 0, self.suite.copy(),
            self.reactions.checkpoint() if self.reactions is not None else None)

    def return_to(self, point: Checkpoint) -> None:
        """Take up a checkpoint of an equal cycle; writes that wait are forgotten."""
        self.t_ns, self.now_ns, self.scan_number = point.place
        self.resource.return_to(point.resource)
        self.exchange.return_to(point.exchange)
        if self.plant is not None and point.plant is not None:
            self.plant.return_to(point.plant)
        if self.player is not None:
            self.player.played = point.played
        for name, number in point.counters.items():
            setattr(self.counters, name, number)
        for each, scans in zip(self.resource.statistics, point.scans, strict=True):
            each.scans = scans
        self.suite = self._own.verdicts.suite = point.suite.copy()
        if self.reactions is not None and point.reactions is not None:
            self.reactions.return_to(point.reactions)
        self.tell_all()
        self._times, self._times_run = list(point.times[0]), point.times[1]
        if point.shown is not None:
            self._started = True
            self.resource.memory.shown = point.shown[0]
            self._last = list(point.shown[1])

    def tell_all(self) -> None:
        """Let the next frame hold every tag, as the first one does."""
        self._started = False
        self._last = [() for _ in self._last]

    # ------------------------------------------------------------ jumping

    def skip_idle(self, limit_ns: int) -> None:
        """Move `t_ns` to the first release, at most the limit's, at which a scan can matter.

        A scan cannot matter while the last ones changed nothing, no clock that the program reads
        runs, nothing waits to be latched, and plant and monitors have no event before it. If nobody
        looks at the elapsed times that the program does not read, these may change and clocks run
        of which it sees only the expiry: that is an event too (docs/timing.md). The last release
        before the limit is never passed over, so that all clocks stand right in the end.
        """
        resource = self.resource
        if self._times_run or self.exchange.waiting or \
                (self.reactions is not None and self.reactions.must_look()):
            return
        rest = resource.rest()
        if rest is None or (not rest.still and (self.observers or self.recorder
                                               or self._elapsed_judged)):
            return
        wakes = [limit_ns, self.suite.next_deadline_ns(), rest.until_ns,
                 self.plant.next_event_ns() if self.plant is not None else None,
                 self.player.next_event_ns() if self.player is not None else None]
        target = resource.first_release_ns(min([w for w in wakes if w is not None]))
        if target >= limit_ns:
            target = resource.last_release_ns(limit_ns)
        if target > self.t_ns and not rest.still:
            target = resource.last_of_each_ns(self.t_ns, target)
        if target > self.t_ns:
            skipped = resource.pass_over(self.t_ns, target)
            self.counters.skipped += skipped
            self.now_ns = self.t_ns = target
            self.scan_number += skipped

    def pass_over(self, t_ns: int, scan_number: int) -> None:
        """Move to a later release without executing those before it, which would change nothing."""
        self.resource.pass_over(self.t_ns, t_ns)
        self.now_ns = self.t_ns = t_ns
        self.scan_number = scan_number

    # ------------------------------------------------------------ running

    def run_virtual(self, until_ns: int, on_progress: Callable[[int], None] | None = None,
                    dense: bool = False) -> None:
        """Execute all releases before an instant in virtual time.

        Releases that cannot matter are skipped, unless the run is to be dense; the trace is the
        same either way.
        """
        while self.t_ns < until_ns:
            self.lap()
            if not dense:
                self.skip_idle(until_ns)
            if on_progress is not None:
                on_progress(min(self.t_ns, until_ns))
        self.finish(until_ns)

    def finish(self, t_ns: int) -> None:
        """Bring plant and monitors to an instant, not after the next release, where a run ends."""
        self.now_ns = t_ns
        if self.plant is not None:
            self.plant.advance(t_ns)
        self.suite.advance(self.end_ns)

    async def run(self, clock: Clock, stop: asyncio.Event, until_ns: int | None = None,
                  after_lap: Callable[[], None] | None = None) -> None:
        """Execute releases as the clock reaches them, until `stop` is set or an instant.

        A lap that ends after the next release is an overrun: it is counted, and the releases that
        it missed are skipped, never made up for in a burst. Who cancels the waiting for a release
        ends the run as well.
        """
        try:
            await self._laps(clock, stop, until_ns, after_lap)
        finally:
            ends = (clock.now_ns(), self.t_ns, self.t_ns if until_ns is None else until_ns)
            self.finish(min(ends))

    async def _laps(self, clock: Clock, stop: asyncio.Event, until_ns: int | None,
                    after_lap: Callable[[], None] | None) -> None:
        while not stop.is_set() and (until_ns is None or self.t_ns < until_ns):
            release = self.t_ns
            await clock.sleep_until_ns(release)
            if stop.is_set():
                break
            begin = clock.now_ns()
            self.lap(clock.now_ns)
            self._account(release, begin, clock.now_ns())
            if after_lap is not None:
                after_lap()
        if until_ns is not None and not stop.is_set():
            await clock.sleep_until_ns(min(until_ns, self.t_ns))

    def _account(self, release: int, begin: int, end: int) -> None:
        counters = self.counters
        counters.late_ns, counters.last_lap_ns = begin - release, end - begin
        counters.max_late_ns = max(counters.max_late_ns, counters.late_ns)
        counters.max_lap_ns = max(counters.max_lap_ns, counters.last_lap_ns)
        if end > self.t_ns:
            following = self.resource.first_release_ns(end)
            counters.overruns += 1
            counters.missed += self.resource.releases_between(self.t_ns, following)
            self.resource.missed(self.t_ns, following)
            self.now_ns = self.t_ns = following
        self._own.tasks.show(end)


_GIVING_WAY = ("resource.", "task.", "retain.", "alarm.")
"""Beginnings of tags that give way to a program's variables of the same ending."""


def _all_tags(resource: Resource, sources: Sequence[Source]) -> TagTable:
    """Return the tags of memory and of the sources.

    `state` means a program's variable of that name, though there is a `resource.state`.
    """
    try:
        table = TagTable(resource.memory.tags)
        for source in sources:
            for tag in source.tags:
                table.add(tag, gives_way=tag.name.startswith(_GIVING_WAY))
    except ValueError as problem:
        raise PlcemuError(f"{problem}; the names plant, resource, task, retain, alarm and "
                          "monitor are taken, and properties need names of their own") from None
    return table
