"""A run in time as a table of real scans: the program at its real cycle, events where they fit.

In the model scans take no time. Here the same events meet the program as it runs, a scan each cycle
and its clocks counting: each event comes in the first scan at or after its instant by which the
program has come to rest, or a scan before a clock expires that the run sees expire later. So the
path plays in `simulate`. Where the program does not follow (an instant of the model is shorter than
the scans it takes), the path shows the model's scans instead, at their instants, and says so.
"""

from __future__ import annotations

import struct
from bisect import bisect_right
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from plcemu.base.errors import ProgramFault
from plcemu.base.time import format_duration
from plcemu.base.types import Value
from plcemu.verify.check import StateGraph
from plcemu.verify.fair import Lasso
from plcemu.verify.loop import ClosedLoop, State
from plcemu.verify.path import Path, Row, row_of
from plcemu.verify.predicates import Predicates
from plcemu.verify.timed.loop import Happens, Passes, TimedLoop

SCANS_LIMIT = 200_000
"""Scans of a path; a longer one is shown without those in which nothing happens."""

_CELL = struct.Struct("<qq")


@dataclass(frozen=True, slots=True)
class Event:
    """Something happens at a model's instant, between two of its states."""

    source: State
    action: Happens
    target: State
    t_ns: int


class _DoesNotFollow(Exception):
    """The program at its real cycle does not do what the model does; says where."""


def timed_path_of(loop: ClosedLoop, graph: StateGraph, predicates: Predicates, run: Lasso,
                  watched: int | None, cycle_ns: int,
                  decided: tuple[int | None, int] | None = None) -> Path:
    """Return a run as a path.

    Args:
        loop: the closed loop, in time.
        graph: in which the run's states are numbered.
        predicates: knows the tags.
        run: what to show.
        watched: the path ends in the scan of its last step in which this watched formula holds.
        cycle_ns: the time between two scans.
        decided: or it is decided in its last step: with this number of its scans, None for all,
            so many ns after the last of them.
    """
    assert isinstance(loop, TimedLoop)
    first = graph.states[run.start]
    origin = loop.origins[first] if run.origin is None else run.origin
    stem, cycle, ends_ns = events_of(loop, graph, run)
    try:
        real = _Real(loop, cycle_ns, origin, first)
        for event in stem:
            real.follow(event)
        writer = _Writer(loop, predicates, real.scans, real.times)
        remark = _lag(stem, real)
        last, repeats = real.last, len(real.scans)
        for event in cycle:
            real.follow(event)
        real.idle(ends_ns if cycle else 0)
        writer.take(real.scans[repeats:], real.times[repeats:])
    except _DoesNotFollow as problem:
        writer, last, repeats = _model(loop, predicates, origin, stem, cycle)
        remark = ("scans are shown at the model's instants; at a cycle of "
                  f"{format_duration(cycle_ns)} the program does not do the same: {problem}")
    fault = graph.states[(run.stem[-1].target if run.stem else run.start)].fault
    shown: int | None = None
    if watched is not None:
        writer.cut(last, watched)
    elif decided is not None:
        writer.keep(last, decided[0])
    elif not fault:
        shown = repeats if cycle else len(writer.rows) - 1
    times, late_ns = writer.times[:len(writer.rows)], 0
    if decided is not None:
        passed_ns = sum(loop.elapsed_ns(first, step.action) for step in run.stem)
        late_ns = max(0, passed_ns + decided[1] - times[-1])
    return Path(loop.plant.name_of(origin), writer.rows, shown, "" if decided else fault,
                cycle_ns, predicates, late_ns, times, remark,
                may_go_on=bool(graph.targets(run.stem[-1].target if run.stem else run.start)))


# ---------------------------------------------------------------- when events happen


def events_of(loop: TimedLoop, graph: StateGraph,
              run: Lasso) -> tuple[list[Event], list[Event], int]:
    """Return the events of a run's stem and of its cycle, with instants at which they can be, and
    the instant at which the cycle ends, in ns."""
    states, actions = [graph.states[run.start]], []
    for step in (*run.stem, *run.cycle):
        states.append(graph.states[step.target])
        actions.append(step.action)
    moves = list(zip(pairwise(states), actions, strict=True))
    units = _by_waiting(actions) if any(isinstance(a, Passes) for a in actions) \
        else _earliest(loop, states, actions)
    events = [[Event(source, action, target, int(at * loop.unit_ns))
               for ((source, target), action), at in zip(part, times, strict=True)
               if isinstance(action, Happens)]
              for part, times in ((moves[:len(run.stem)], units[:len(run.stem)]),
                                  (moves[len(run.stem):], units[len(run.stem):]))]
    ends = units[-1] + (actions[-1].units if isinstance(actions[-1], Passes) else 0) \
        if run.cycle else 0
    return events[0], events[1], int(ends * loop.unit_ns)


def _by_waiting(actions: Sequence[Any]) -> list[int]:
    """Return the instant of each action, in units, from the steps in which time passes."""
    now, times = 0, []
    for action in actions:
        times.append(now)
        now += action.units if isinstance(action, Passes) else 0
    return times


def _earliest(loop: TimedLoop, states: Sequence[State], actions: Sequence[Any]) -> list[int]:
    """Return the earliest instants of actions, in units, that all bounds on the way allow.

    Each bound is one of the difference of two instants, an action's and that of the last one that
    set the clock; the least solution is found by Bellman and Ford's algorithm (1958).
    """
    set_at: dict[int, int] = {}
    later: list[tuple[int, int, int]] = []
    for k, (source, action) in enumerate(zip(states, actions, strict=False), 1):
        later.append((k, k - 1, 0))
        if not isinstance(action, Happens):
            continue
        place = loop.place(source)
        guards = [g for s in place.singles for g in s.guard
                  if (s.event in action.events if s.expired is None
                      else s.expired in action.expired)]
        for n, low, high in (*guards, *((n, 0, high) for n, high in place.latest)):
            begin = set_at.get(n, 0)
            later.append((k, begin, low))
            if high is not None:
                later.append((begin, k, -high))
        set_at.update(dict.fromkeys(place.entries[action].resets, k))
    times = [0] * (len(actions) + 1)
    for _ in times:
        before = times[:]
        for k, base, distance in later:
            times[k] = max(times[k], times[base] + distance)
        if times == before:
            break
    return times[1:]


def _lag(events: Sequence[Event], real: _Real) -> str:
    late = max((abs(at - e.t_ns) for e, at in zip(events, real.taken, strict=True)), default=0)
    return (f"events are up to {format_duration(late)} off their instants in the model, where "
            "scans take no time") if late else ""


# ---------------------------------------------------------------- the program as it runs


class _Real:
    """The program's scans at its cycle, driven through a run's events."""

    def __init__(self, loop: TimedLoop, cycle_ns: int, origin: Hashable,
                 first: State) -> None:
        self.loop, self.cycle_ns = loop, cycle_ns
        self.memory, self.plant = loop.machine.initial, origin
        self.scans: list[tuple[bytes, Hashable, str]] = []
        self.taken: list[int] = []
        self.last = 0
        rest = bytearray(b"\xff" * len(self.memory))
        for byte in loop.seen.copies:
            rest[byte] = 0
        self._rest = int.from_bytes(rest, "little")
        self._settle(first, "cold start", None)

    @property
    def t_ns(self) -> int:
        """The instant of the next scan."""
        return len(self.scans) * self.cycle_ns

    @property
    def times(self) -> list[int]:
        """The instants of all scans."""
        return [n * self.cycle_ns for n in range(len(self.scans))]

    def follow(self, event: Event) -> None:
        """Wait for an event's scan, and go on until program and plant rest where it leads."""
        while not self._is_due(event):
            if len(self.scans) > SCANS_LIMIT:
                raise _DoesNotFollow(f"more than {SCANS_LIMIT:,} scans")
            self._scan("")
            if self._shape(self.memory) != self._shape(event.source.memory):
                raise _DoesNotFollow(f"before \"{event.action}\" something else happens")
        self.taken.append(self.t_ns)
        self.last = len(self.scans)
        for each in event.action.events:
            self.plant = self.loop.plant.after(self.plant, each)
        self._settle(event.target, str(event.action), event)

    def idle(self, until_ns: int) -> None:
        """Make scans up to an instant while none of the program's clocks expires."""
        classes = self._classes(self.memory)
        while self.t_ns < until_ns and len(self.scans) <= SCANS_LIMIT and \
                self._classes(self._later(1)) == classes:
            self._scan("")

    def _is_due(self, event: Event) -> bool:
        """Whether the next scan is the one that sees an event.

        It is if the program's clocks stand then as they do in the model, if the instant has come,
        or one more scan would see one of them expire.
        """
        wanted = self._classes(self.loop.given(event.source.memory, event.action.expired))
        if event.action.expired:
            return self._classes(self._later(1)) == wanted
        return self.t_ns >= event.t_ns or self._classes(self._later(2)) != wanted

    def _later(self, cycles: int) -> bytes:
        """Return memory with the program's clocks some cycles on."""
        block = bytearray(self.memory)
        for clock in self.loop.own:
            elapsed, limit = _CELL.unpack_from(block, clock.offset)
            if elapsed < limit:
                now = min(elapsed + cycles * self.cycle_ns, limit)
                _CELL.pack_into(block, clock.offset, now, limit)
        return bytes(block)

    def _settle(self, target: State, text: str, event: Event | None) -> None:
        """Scan until program and plant are where the model's step led."""
        loop = self.loop
        for n in range(_PATIENCE):
            if not self._scan(text if n == 0 and event is not None else ""):
                if target.fault:
                    return
                raise _DoesNotFollow(f"it faults after \"{text}\"")
            if not target.fault and self._shape(self.memory) == self._shape(target.memory) and \
                    loop.plant.settled(self.plant) == target.plant:
                self.plant = loop.plant.settled(self.plant)
                return
        raise _DoesNotFollow(f"after \"{text}\" it does something else")

    def _scan(self, text: str) -> bool:
        """Make a scan; return False if the program faults."""
        loop, elapsed = self.loop, self.cycle_ns if self.scans else 0
        try:
            self.memory = loop.scan(self.memory, self.plant, elapsed)
        except ProgramFault:
            return False
        self.scans.append((self.memory, self.plant, text))
        self.plant = loop.outcome(self.memory, self.plant)[1]
        return True

    def _shape(self, memory: bytes) -> tuple[int, tuple[int, ...]]:
        """Return what of memory matters: elapsed times only by their classes."""
        reduced = self.loop.machine.reduced(memory)
        return int.from_bytes(reduced, "little") & self._rest, self._classes(memory)

    def _classes(self, memory: bytes) -> tuple[int, ...]:
        return tuple(bisect_right(c.thresholds, _CELL.unpack_from(memory, c.offset)[0])
                     for c in self.loop.own)


_PATIENCE = 1000


# ---------------------------------------------------------------- rows


class _Writer:
    """Collects rows."""

    def __init__(self, loop: TimedLoop, predicates: Predicates,
                 scans: Sequence[tuple[bytes, Hashable, str]], times: Sequence[int]) -> None:
        self.loop, self.predicates = loop, predicates
        self.rows: list[Row] = []
        self.times: list[int] = []
        self._before: tuple[Value, ...] = ()
        self._scans: list[tuple[bytes, Hashable, str]] = []
        self.take(scans, times)

    def take(self, scans: Sequence[tuple[bytes, Hashable, str]], times: Sequence[int]) -> None:
        """Append rows for scans."""
        for memory, plant, text in scans:
            values = tuple(self.predicates.values(memory, self.loop.facts(plant)))
            self.rows.append(row_of(len(self.rows), text, self.predicates, values, self._before,
                                    self.loop.raw_inputs(plant)))
            self._before = values
        self.times += times
        self._scans += scans

    def keep(self, first: int, scans: int | None) -> None:
        """Keep so many scans from a certain one on; all if None."""
        if scans is not None:
            del self.rows[first + scans:]

    def cut(self, first: int, watched: int) -> None:
        """Drop the scans after the first one, from a certain one on, in which a formula holds."""
        for n in range(first, len(self._scans)):
            memory, plant, _ = self._scans[n]
            if self.loop.watch(memory, self.loop.facts(plant)) >> watched & 1:
                del self.rows[n + 1:]
                return


def _model(loop: TimedLoop, predicates: Predicates, origin: Hashable, stem: Sequence[Event],
           cycle: Sequence[Event]) -> tuple[_Writer, int, int]:
    """Return the model's own scans, those at one instant a ns after one another."""
    scans = [(m, p, "") for m, p in loop.first_scans(origin)[0]]
    times = list(range(len(scans)))
    last = repeats = 0
    for k, event in enumerate((*stem, *cycle)):
        if k < len(stem):
            last = len(scans)
        if k == len(stem):
            repeats = len(scans)
        for n, (memory, plant) in enumerate(loop.scans(event.source, event.action)[0]):
            scans.append((memory, plant, str(event.action) if n == 0 else ""))
            times.append(max(event.t_ns, times[-1] + 1))
    return _Writer(loop, predicates, scans, times), last, repeats or len(scans)


__all__ = ["Event", "events_of", "timed_path_of"]
