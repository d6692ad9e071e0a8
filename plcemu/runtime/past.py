"""The past of a recorded run: scans that are executed again, traced, and what changed when."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass
from itertools import pairwise

from plcemu.engine.dependence import Dependences, Reads
from plcemu.engine.engines import Code
from plcemu.engine.memory import differing_bytes
from plcemu.engine.resource import State
from plcemu.engine.tracer import Tracer
from plcemu.ir.program import Task
from plcemu.runtime.cycle import Cycle
from plcemu.runtime.debugger import ScanTrace
from plcemu.runtime.history import History

SCANS_KEPT = 64
"""Traced scans kept while an explanation is made."""



class Past:
    """Executes recorded scans again and keeps what happened in them."""

    def __init__(self, history: History, bench: Cycle) -> None:
        self._history = history
        self._bench = bench
        self._tracer = Tracer(bench.resource.program, bench.resource.memory)
        self._dependences = Dependences(bench.resource.program.functions)
        self._scans: dict[int, RecordedScan] = {}
        self._stretches: dict[int, dict[int, list[int]]] = {}
        self._clocks = [range(c.offset, c.offset + 16)
                        for c in bench.resource.memory.layout.clocks]
        self._ends: list[tuple[int, bytes]] = []
        first = history.executed_before(history.first_scan + 1)
        self.first = history.first_scan if first is None else first

    def trace(self, scan: int) -> ScanTrace:
        """Return what happened inside a scan."""
        return self._scan(scan).trace

    def after(self, scan: int) -> bytes:
        """Return the memory after a scan."""
        return self._scan(scan).after

    def before(self, scan: int) -> bytes:
        """Return the memory that a scan found, before it latched anything."""
        return self._scan(scan).before

    def forces(self, scan: int) -> dict[int, bytes]:
        """Return the forces in a scan."""
        return self._scan(scan).forces

    def writers(self, scan: int) -> set[str]:
        """Return the names of those whose writes to inputs a scan latched."""
        return self._scan(scan).writers

    def state(self, scan: int) -> State:
        """Return the PLC's state after a scan."""
        return self._scan(scan).state

    def reads(self, scan: int) -> dict[int, Reads]:
        """Return which reads the writes of a scan depend on."""
        found = self._scan(scan)
        if found.reads is None:
            found.reads = self._dependences.of(found.trace.events)
        return found.reads

    def is_clock(self, place: range) -> bool:
        """Whether memory belongs to a clock, which time moves."""
        return any(place.start < clock.stop and clock.start < place.stop for clock in self._clocks)

    def came_in(self, scan: int, place: range) -> bool:
        """Whether memory had another value at the beginning of a scan than after the one before."""
        found = self._scan(scan)
        begin = found.trace.images[0][1] if found.trace.images else found.after
        return found.before[place.start:place.stop] != begin[place.start:place.stop]

    def changed(self, place: range, before: int) -> int | None:
        """Return the last scan before another in which memory changed, as seen after scans."""
        at = self._history.executed_before(before)
        while at is not None:
            first, last = self._history.stretch(at)
            if first not in self._stretches:
                self._stretches[first] = self._changes(first, last)
            changes = self._stretches[first]
            found = [scans[n - 1] for byte in place if (scans := changes.get(byte))
                     and (n := bisect_left(scans, before))]
            if found:
                return max(found)
            at = self._history.executed_before(first)
        return None

    def _changes(self, first: int, last: int) -> dict[int, list[int]]:
        """Return for each byte the scans of a stretch in which it changed, in order."""
        block = self._bench.resource.memory.block
        images = [(first, self._found(first))]
        self._history.execute(self._bench, first, last,
                              lambda number: images.append((number, bytes(block))))
        found: dict[int, list[int]] = {}
        for (_, old), (number, new) in pairwise(images):
            for byte in differing_bytes(old, new):
                found.setdefault(byte, []).append(number)
        return found

    def _found(self, scan: int) -> bytes:
        """Return the memory after the scan executed before; before the first, the initial one."""
        earlier = self._history.executed_before(scan)
        if earlier is None and self._history.first_scan == 0:
            return self._bench.resource.memory.layout.initial
        if earlier is None:
            self._history.place(self._bench, scan)
            return self._bench.resource.memory.snapshot()
        self._history.execute(self._bench, earlier, earlier)
        return self._bench.resource.memory.snapshot()

    def _scan(self, scan: int) -> RecordedScan:
        found = self._scans.get(scan)
        if found is None:
            while len(self._scans) >= SCANS_KEPT:
                del self._scans[next(iter(self._scans))]
            found = self._scans[scan] = self._look_into(scan)
        return found

    def _look_into(self, scan: int) -> RecordedScan:
        resource = self._bench.resource
        before = self._found(scan)
        trace = ScanTrace(scan, self._history.released_ns(scan))

        def probe(task: Task, code: Code) -> None:
            if self._bench.scan_number != scan:
                code.run()  # on the way there from the keyframe
                return
            trace.images.append((len(trace.events), bytes(resource.memory.block)))
            instances = [resource.program.instance(name) for name in task.programs]
            trace.events.extend(self._tracer.events(
                [(i.function, i.base) for i in instances], task.name, code.budget))

        probing, resource.probe = resource.probe, probe
        try:
            self._history.execute(self._bench, scan, scan)
        finally:
            resource.probe = probing
        return RecordedScan(trace, before, resource.memory.snapshot(), self._bench.exchange.forces,
                            resource.state, set(self._bench.exchange.writers))


@dataclass(slots=True)
class RecordedScan:
    """A scan that was executed again: the memory before and after it, and what happened in it."""

    trace: ScanTrace
    before: bytes
    after: bytes
    forces: dict[int, bytes]
    state: State
    writers: set[str]
    reads: dict[int, Reads] | None = None
