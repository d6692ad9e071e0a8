"""The cycle: one lap after another, in one direction (docs/timing.md numbers its phases).

    1 latch inputs  2 scan due tasks  3 publish outputs  4 frame to observers  5 plant  6 sleep

The same loop runs in real and in virtual time; only the clock differs.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from plcemu.base.tags import Tag, TagTable
from plcemu.base.time import Clock
from plcemu.base.trace import Change, Frame, Observer
from plcemu.base.types import Value
from plcemu.engine.resource import Resource
from plcemu.io.exchange import Exchange
from plcemu.monitor import Suite
from plcemu.monitor.parse import Property
from plcemu.runtime.local_plant import LocalPlant


class Source(Protocol):
    """Tags whose values do not stand in memory."""

    @property
    def tags(self) -> Sequence[Tag]:
        """The tags, in a fixed order."""

    def values(self) -> Sequence[Value]:
        """Their present values."""


@dataclass(slots=True)
class CycleCounters:
    """What the cycle counts.

    Attributes:
        laps: laps executed.
        skipped: releases passed over because nothing could change (virtual time).
        overruns: laps that ended after the next release.
        missed: releases lost to overruns.
        late_ns: how long after its release the last lap began.
        max_late_ns: the largest of these.
        last_lap_ns: how long the last lap took, by the clock.
        max_lap_ns: the largest of these.
    """

    laps: int = 0
    skipped: int = 0
    overruns: int = 0
    missed: int = 0
    late_ns: int = 0
    max_late_ns: int = 0
    last_lap_ns: int = 0
    max_lap_ns: int = 0
    tags: list[Tag] = field(default_factory=lambda: [
        Tag("task.overruns", "ULINT", comment="laps that ended after the next release"),
        Tag("task.missed", "ULINT", comment="releases lost to overruns")])

    def values(self) -> list[Value]:
        """Return the values of the tags."""
        return [self.overruns, self.missed]


class _Verdicts:
    """The monitors' verdicts as tags."""

    def __init__(self, properties: Sequence[Property]) -> None:
        self.tags = [Tag(f"monitor.{p.name}.verdict", "STRING", comment=p.description)
                     for p in properties]
        self.suite: Suite | None = None

    def values(self) -> list[Value]:
        if self.suite is None:
            return ["presumably satisfied"] * len(self.tags)
        return [verdict.value for verdict in self.suite.verdicts()]


class Cycle:
    """Runs a resource lap by lap.

    Args:
        resource: with its program.
        exchange: over the resource's memory.
        plant: a plant in this process, or None.
        properties: judged while it runs.
    """

    def __init__(self, resource: Resource, exchange: Exchange, plant: LocalPlant | None = None,
                 properties: Sequence[Property] = ()) -> None:
        self.resource = resource
        self.exchange = exchange
        self.plant = plant
        self.counters = CycleCounters()
        self.t_ns = resource.first_release_ns(0)
        self.scan_number = 0
        self.observers: list[Observer] = []
        self._verdicts = _Verdicts(properties)
        self._sources: list[Source] = [s for s in (plant, self.counters) if s is not None]
        self._last: list[Sequence[Value]] = []
        self.tags = TagTable([*resource.memory.tags,
                              *(t for s in [*self._sources, self._verdicts] for t in s.tags)])
        self.suite = Suite(properties, self.tags)
        self._verdicts.suite = self.suite
        self._started = False

    # ------------------------------------------------------------ one lap

    def lap(self) -> None:
        """Execute the lap at `t_ns`, then let `t_ns` be the next release."""
        t_ns = self.t_ns
        if self.plant is not None:
            self.plant.before_scan(t_ns)
        if self.exchange.waiting:
            self.resource.inputs_changed()
        self.exchange.update_inputs()
        self.resource.scan(t_ns)
        self.exchange.update_outputs()
        self._show(t_ns)
        if self.plant is not None:
            self.plant.after_scan()
        self.counters.laps += 1
        self.scan_number += 1
        self.t_ns = self.resource.first_release_ns(t_ns + 1)

    def _show(self, t_ns: int) -> None:
        """Make the frame of this lap; the monitors judge it first, their verdicts join it."""
        changes = self._changes()
        frame = Frame(t_ns, self.scan_number, changes)
        undecided = self.suite.undecided
        self.suite.observe(frame)
        verdicts = self._verdict_changes() if changes or self.suite.undecided != undecided else ()
        if verdicts:
            frame = Frame(t_ns, self.scan_number, changes + verdicts)
        for observer in self.observers:
            observer.observe(frame)

    def _changes(self) -> tuple[Change, ...]:
        memory = self.resource.memory
        if not self._started:
            self._started = True
            self._last = [s.values() for s in [*self._sources, self._verdicts]]
            base, changes = len(memory.tags), list(memory.values())
            for value in (v for values in self._last for v in values):
                changes.append((base, value))
                base += 1
            return tuple(changes)
        changes, base = list(memory.changes()), len(memory.tags)
        for n, source in enumerate(self._sources):
            changes += self._moved(n, base, source.values())
            base += len(source.tags)
        return tuple(changes)

    def _moved(self, n: int, base: int, now: Sequence[Value]) -> list[Change]:
        before = self._last[n]
        if now is before or now == before:
            return []
        moved = [(base + i, new) for i, (old, new) in enumerate(zip(before, now, strict=True))
                 if old != new]
        self._last[n] = now
        return moved

    def _verdict_changes(self) -> tuple[Change, ...]:
        if not self._verdicts.tags:
            return ()
        base = len(self.tags) - len(self._verdicts.tags)
        return tuple(self._moved(len(self._sources), base, self._verdicts.values()))

    # ------------------------------------------------------------ jumping

    def skip_idle(self, limit_ns: int) -> None:
        """Move `t_ns` to the first release, at most the limit's, at which a scan can matter.

        A scan cannot matter while the last ones changed no byte, no clock that the program reads
        runs, nothing waits to be latched, and plant and monitors have no event before it.
        """
        if not self.resource.is_quiet() or self.exchange.waiting:
            return
        wakes = [limit_ns, self.suite.next_deadline_ns(),
                 self.plant.next_event_ns() if self.plant is not None else None]
        wake = min(w for w in wakes if w is not None)
        if wake > self.t_ns:
            target = self.resource.first_release_ns(min(wake, limit_ns))
            skipped = self.resource.releases_between(self.t_ns, target)
            self.counters.skipped += skipped
            self.scan_number += skipped
            self.t_ns = target

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
        """Bring plant and monitors to an instant at which a run ends."""
        if self.plant is not None and not self.plant.stepped_aside:
            self.plant.coupling.advance(t_ns)
        self.suite.advance(t_ns)

    async def run(self, clock: Clock, stop: asyncio.Event, until_ns: int | None = None,
                  after_lap: Callable[[], None] | None = None) -> None:
        """Execute releases as the clock reaches them, until `stop` is set or an instant.

        A lap that ends after the next release is an overrun: it is counted, and the releases that
        it missed are skipped, never made up for in a burst.
        """
        while not stop.is_set() and (until_ns is None or self.t_ns < until_ns):
            release = self.t_ns
            await clock.sleep_until_ns(release)
            if stop.is_set():
                break
            begin = clock.now_ns()
            self.lap()
            self._account(release, begin, clock.now_ns())
            if after_lap is not None:
                after_lap()
        self.finish(self.t_ns if until_ns is None else min(self.t_ns, until_ns))

    def _account(self, release: int, begin: int, end: int) -> None:
        counters = self.counters
        counters.late_ns, counters.last_lap_ns = begin - release, end - begin
        counters.max_late_ns = max(counters.max_late_ns, counters.late_ns)
        counters.max_lap_ns = max(counters.max_lap_ns, counters.last_lap_ns)
        if end >= self.t_ns:
            following = self.resource.first_release_ns(end + 1)
            counters.overruns += 1
            counters.missed += self.resource.releases_between(self.t_ns, following)
            self.t_ns = following
