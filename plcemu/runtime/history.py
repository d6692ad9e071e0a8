"""Time travel: a cycle's past, to which it can return and which it can run again.

A state is bytes, and a lap is a function of the state and of the writes that waited for it. So the
history keeps a keyframe (a whole state, compressed) now and then, and for each lap in between its
release and the writes of its clients. A past state is the keyframe before it, and the laps from
there on executed again; a plant in the process writes its inputs anew.

Whatever else is done to the PLC between two laps (a force, STOP, another memory image) is noticed
before the next lap, which then begins with a keyframe of its own.
"""

from __future__ import annotations

import json
import zlib
from array import array
from bisect import bisect_left
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from plcemu.base.errors import PlcemuError
from plcemu.base.trace import Trace
from plcemu.base.types import Value
from plcemu.engine.memory import Memory
from plcemu.io.exchange import Port, Waiting
from plcemu.runtime.cycle import Checkpoint, Cycle
from plcemu.runtime.local_plant import LocalPlant

LIMIT_BYTES = 64 * 2**20
"""What a history may take by default, in bytes; beyond it the oldest laps are forgotten."""

LAPS_A_KEYFRAME = 256
"""Laps after which a keyframe is made: a return executes fewer laps than this again."""

_WRITE_BYTES = 200
"""What a recorded write takes besides its data, in bytes."""

_MONITOR_BYTES = 4096
"""What the monitors' state in a keyframe is taken to need, in bytes."""


class HistoryError(PlcemuError):
    """A scan that is not, or no longer, in the history."""


@dataclass(slots=True)
class _Segment:
    """A keyframe and the laps from it on.

    Attributes:
        keyframe: the state before the first lap, packed.
        laps: release in ns and scan number of each lap, one pair after another.
        writes: what clients had written for a lap, by the lap's place in the segment.
        size: bytes that it takes, about.
    """

    keyframe: Checkpoint
    laps: array[int] = field(default_factory=lambda: array("q"))
    writes: dict[int, tuple[Waiting, ...]] = field(default_factory=dict)
    size: int = 0

    @property
    def first_scan(self) -> int:
        """The scan that the keyframe stands before."""
        return self.keyframe.place[2]

    def __len__(self) -> int:
        return len(self.laps) // 2

    def lap(self, n: int) -> tuple[int, int, tuple[Waiting, ...]]:
        """Return release, scan number and writes of a lap."""
        return self.laps[2 * n], self.laps[2 * n + 1], self.writes.get(n, ())


class History:
    """Records the laps of a cycle, from now on.

    Args:
        cycle: in virtual time.
        limit_bytes: what it may take, about; then the oldest laps are forgotten. The laps since the
            last keyframe are always kept.

    Raises:
        HistoryError: a limit that is not positive.
    """

    def __init__(self, cycle: Cycle, limit_bytes: int = LIMIT_BYTES) -> None:
        if limit_bytes <= 0:
            raise HistoryError(f"found a history of {limit_bytes} bytes, expected more than 0")
        self.limit_bytes = limit_bytes
        self._cycle = cycle
        self._segments: deque[_Segment] = deque()
        self._size = 0
        self._end = cycle.scan_number
        self._left: object = None
        cycle.recorder = self

    # ------------------------------------------------------------ recording

    def before_lap(self) -> None:
        """Record what the lap depends on; forget the laps that it takes the place of."""
        cycle = self._cycle
        if cycle.scan_number < self._end:
            self._cut(cycle.scan_number)
        if not self._segments or self._is_full(self._segments[-1]) or self._fixed() != self._left:
            self._begin()
        segment = self._segments[-1]
        writes = cycle.exchange.waiting_writes(LocalPlant.PORT) if cycle.exchange.waiting else ()
        if writes:
            segment.writes[len(segment)] = writes
        segment.laps.extend((cycle.t_ns, cycle.scan_number))
        self._grow(segment, 16 + sum(len(w.data) + _WRITE_BYTES for w in writes))

    def after_lap(self) -> None:
        """Note how the lap left the PLC."""
        self._left = self._fixed()
        self._end = self._cycle.scan_number

    def _fixed(self) -> object:
        """Return what nobody changes between two laps, unless by more than a write."""
        cycle = self._cycle
        return (cycle.resource.checkpoint(), cycle.exchange.forces,
                cycle.reactions.checkpoint() if cycle.reactions is not None else None)

    def _is_full(self, segment: _Segment) -> bool:
        return len(segment) >= LAPS_A_KEYFRAME or segment.size > self.limit_bytes // 4

    def _begin(self) -> None:
        keyframe = _pack(self._cycle.checkpoint())
        segment = _Segment(keyframe)
        self._segments.append(segment)
        self._grow(segment, _size(keyframe))
        while self._size > self.limit_bytes and len(self._segments) > 1:
            self._size -= self._segments.popleft().size

    def _grow(self, segment: _Segment, size: int) -> None:
        segment.size += size
        self._size += size

    def _cut(self, scan: int) -> None:
        """Forget the laps from a scan on."""
        while self._segments and self._segments[-1].first_scan > scan:
            self._size -= self._segments.pop().size
        if self._segments:
            segment = self._segments[-1]
            kept = sum(1 for number in segment.laps[1::2] if number < scan)
            del segment.laps[2 * kept:]
            gone = sum(len(w.data) + _WRITE_BYTES for n, writes in segment.writes.items()
                       for w in writes if n >= kept)
            segment.writes = {n: w for n, w in segment.writes.items() if n < kept}
            self._grow(segment, -gone)

    # ------------------------------------------------------------ what is known

    @property
    def size(self) -> int:
        """Bytes that the history takes, about."""
        return self._size

    @property
    def first_scan(self) -> int:
        """The oldest scan to which the cycle can return."""
        return self._segments[0].first_scan if self._segments else self._cycle.scan_number

    @property
    def end_scan(self) -> int:
        """The scan after the last one recorded, which may lie in the future after a rewind."""
        return max(self._end, self._cycle.scan_number)

    def scan_at(self, t_ns: int) -> int:
        """Return the first scan, of those recorded, whose release is not before an instant.

        Raises:
            HistoryError: the instant is not in the history.
        """
        at = self._cycle.resource.first_release_ns(t_ns)
        for segment in reversed(self._segments):
            begin, _, scan = segment.keyframe.place
            if begin <= at:
                for n in range(len(segment)):
                    t_lap, number, _ = segment.lap(n)
                    if t_lap > at:
                        break
                    begin, scan = t_lap, number
                return scan + self._cycle.resource.releases_between(begin, at)
        raise HistoryError(self._reach(f"the instant {t_ns} ns is"))

    @property
    def is_untouched(self) -> bool:
        """Whether nothing was done to the cycle since its last lap, rewind or replay."""
        return self._fixed() == self._left and \
            not self._cycle.exchange.waiting_writes(LocalPlant.PORT)

    def _reach(self, what: str) -> str:
        if not self._segments:
            return f"{what} not recorded: no scan was executed since recording began"
        begin_ns = self._segments[0].keyframe.place[0]
        return (f"{what} not recorded: the history reaches from scan {self.first_scan} "
                f"(t = {begin_ns / 1e9:g} s) to scan {self.end_scan}, and may take "
                f"{self.limit_bytes} bytes; older scans are forgotten")

    # ------------------------------------------------------------ travelling

    def rewind(self, scan: int) -> None:
        """Return to where the cycle stood before a scan; writes that wait are forgotten.

        Traces that observe the cycle are cut there. The recorded future stays until another lap
        takes its place, so that it can be replayed.

        Raises:
            HistoryError: the scan is not in the history.
        """
        self._end = self.end_scan
        self.place(self._cycle, scan)
        self._left = self._fixed()
        for observer in self._cycle.observers:
            if isinstance(observer, Trace):
                observer.cut(scan)

    def place(self, cycle: Cycle, scan: int) -> None:
        """Bring a cycle of the same program to where the recorded one stood before a scan.

        Raises:
            HistoryError: the scan is not in the history.
        """
        if not self.first_scan <= scan <= self.end_scan or not self._segments:
            raise HistoryError(self._reach(f"scan {scan} is"))
        observers, recorder = cycle.observers, cycle.recorder
        cycle.observers, cycle.recorder = [], None
        try:
            segment = next(s for s in reversed(self._segments) if s.first_scan <= scan)
            cycle.return_to(_unpack(segment.keyframe))
            _execute(cycle, segment, scan)
            _pass_over(cycle, scan)
        finally:
            cycle.observers, cycle.recorder = observers, recorder

    def executed_before(self, scan: int) -> int | None:
        """Return the last scan before another that was executed, not passed over."""
        for segment in reversed(self._segments):
            if segment.first_scan < scan:
                numbers = segment.laps[1::2]
                n = bisect_left(numbers, scan)
                if n:
                    return numbers[n - 1]
        return None

    def stretch(self, scan: int) -> tuple[int, int]:
        """Return the first and the last executed scan of the keyframe that a scan goes back to.

        Raises:
            HistoryError: the scan is not in the history.
        """
        segment = self._segment_of(scan)
        return segment.laps[1], segment.laps[-1]

    def released_ns(self, scan: int) -> int:
        """Return the release of an executed scan.

        Raises:
            HistoryError: it is not in the history.
        """
        segment = self._segment_of(scan)
        return segment.laps[2 * bisect_left(segment.laps[1::2], scan)]

    def writes_of(self, scan: int) -> tuple[Waiting, ...]:
        """Return what clients had written for an executed scan, in order.

        Raises:
            HistoryError: it is not in the history.
        """
        segment = self._segment_of(scan)
        return segment.writes.get(bisect_left(segment.laps[1::2], scan), ())

    def execute(self, cycle: Cycle, first: int, last: int,
                after_lap: Callable[[int], None] | None = None) -> None:
        """Let a cycle of the same program execute scans as recorded, from one to another.

        Both are executed scans of one stretch.

        Raises:
            HistoryError: they are not in the history.
        """
        segment = self._segment_of(first)
        self.place(cycle, first)
        observers, recorder = cycle.observers, cycle.recorder
        cycle.observers, cycle.recorder = [], None
        try:
            _execute(cycle, segment, last + 1, after_lap)
        finally:
            cycle.observers, cycle.recorder = observers, recorder

    def _segment_of(self, scan: int) -> _Segment:
        for segment in reversed(self._segments):
            if segment.first_scan <= scan and len(segment):
                return segment
        raise HistoryError(self._reach(f"scan {scan} is"))

    def replay(self, until_scan: int | None = None) -> None:
        """Execute the recorded laps again from here on, up to a scan or to the end of the record.

        Raises:
            HistoryError: something was changed since the rewind, or the scan is not recorded.
        """
        cycle = self._cycle
        end = self.end_scan if until_scan is None else until_scan
        if end < cycle.scan_number:
            raise HistoryError(f"scan {end} lies behind: the PLC stands before scan "
                               f"{cycle.scan_number}; rewind to it")
        if end > self.end_scan:
            raise HistoryError(self._reach(f"scan {end} is"))
        if not self.is_untouched:
            raise HistoryError("the PLC was changed since the rewind: only what was recorded can "
                               "be replayed; rewind again first, or change a fork")
        recorder, cycle.recorder = cycle.recorder, None
        try:
            for segment in list(self._segments):
                if segment.first_scan >= end:
                    break
                if segment.first_scan >= cycle.scan_number:
                    cycle.return_to(_unpack(segment.keyframe))
                _execute(cycle, segment, end)
            _pass_over(cycle, end)
        finally:
            cycle.recorder = recorder
            self._left = self._fixed()


def _execute(cycle: Cycle, segment: _Segment, before_scan: int,
             after_lap: Callable[[int], None] | None = None) -> None:
    """Execute a segment's laps, from where the cycle stands up to a scan."""
    ports: dict[str, Port] = {}
    for n in range(len(segment)):
        t_ns, number, writes = segment.lap(n)
        if number < cycle.scan_number:
            continue
        if number >= before_scan:
            return
        cycle.pass_over(t_ns, number)
        for write in writes:
            port = ports.setdefault(write.port, cycle.exchange.port(write.port))
            port.write(*write[1:])
        cycle.lap()
        if after_lap is not None:
            after_lap(number)


def _pass_over(cycle: Cycle, scan: int) -> None:
    """Move to a scan, over those before it at which nothing could change, plant and all."""
    resource, t_ns, missing = cycle.resource, cycle.t_ns, scan - cycle.scan_number
    tasks = resource.tasks
    if len(tasks) == 1 and not (tasks[0].event and tasks[0].interval_ns):
        step = resource.first_release_ns(t_ns + 1) - t_ns
        t_ns += step * missing
    else:
        for _ in range(missing):
            t_ns = resource.first_release_ns(t_ns + 1)
    cycle.pass_over(t_ns, scan)
    cycle.finish(t_ns)


# ---------------------------------------------------------------- comparing


class Difference(NamedTuple):
    """A tag whose value differs between two states."""

    name: str
    old: Value
    new: Value


def differences(memory: Memory, old: bytes, new: bytes) -> list[Difference]:
    """Return the tags whose values differ in two images of a memory block, in order of the table.

    Values differ if they print differently: 0.0 and -0.0 do, two NaN do not.

    Raises:
        ValueError: an image is of another layout.
    """
    for image in (old, new):
        if len(image) != memory.layout.size:
            raise ValueError(f"the image has {len(image)} bytes, this program's memory "
                             f"{memory.layout.size}; it is of another program")
    found = []
    for index, tag in enumerate(memory.tags):
        offset, row = memory.place(index)
        if old[offset:offset + row.size] != new[offset:offset + row.size]:
            before, after = row.unpack(old, offset), row.unpack(new, offset)
            if repr(before) != repr(after):
                found.append(Difference(tag.name, before, after))
    return found


# ---------------------------------------------------------------- keyframes


def _pack(point: Checkpoint) -> Checkpoint:
    """Return a checkpoint with its large parts compressed."""
    memory = point.resource.memory
    shown = point.shown
    if shown is not None:
        shown = (b"" if shown[0] == memory else zlib.compress(shown[0], 1), shown[1])
    plant = point.plant
    if plant is not None:
        text = json.dumps(plant.coupling.plant)
        coupling = plant.coupling._replace(plant={"": zlib.compress(text.encode(), 1)})
        plant = plant._replace(coupling=coupling)
    return replace(point, shown=shown, plant=plant,
                   resource=point.resource._replace(memory=zlib.compress(memory, 1)),
                   exchange=point.exchange._replace(image=zlib.compress(point.exchange.image, 1)))


def _unpack(point: Checkpoint) -> Checkpoint:
    memory = zlib.decompress(point.resource.memory)
    shown = point.shown
    if shown is not None:
        shown = (zlib.decompress(shown[0]) if shown[0] else memory, shown[1])
    plant = point.plant
    if plant is not None:
        image: dict[str, Any] = json.loads(zlib.decompress(plant.coupling.plant[""]))
        plant = plant._replace(coupling=plant.coupling._replace(plant=image))
    return replace(point, shown=shown, plant=plant,
                   resource=point.resource._replace(memory=memory),
                   exchange=point.exchange._replace(image=zlib.decompress(point.exchange.image)))


def _size(point: Checkpoint) -> int:
    """Return about how many bytes a packed checkpoint takes."""
    size = len(point.resource.memory) + len(point.exchange.image) + _MONITOR_BYTES
    size += _WRITE_BYTES * len(point.exchange.forces)
    if point.shown is not None:
        size += len(point.shown[0]) + sum(64 * len(values) for values in point.shown[1])
    if point.plant is not None:
        size += len(point.plant.coupling.plant[""]) + 64 * len(point.plant.values)
    return size
