"""Why a tag has its value: the chain of instructions, steps, timers and inputs that made it so.

A backward slice through a recorded run. A value leads to the instruction that wrote it last in the
scan that is looked at; what that instruction depends on was either written earlier in the same scan
or has stood since an earlier one, which is the scan in which it changed last. Scans are executed
again for this, traced instruction by instruction. A branch ends at an input, at a constant, at an
initial value, or at a limit, which is said.

Standard function blocks are shown as one call: their outputs are explained by their inputs, and by
their own value from before where they hold it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from plcemu.base.areas import SIZES, parse_address
from plcemu.base.errors import PlcemuError, UnknownNameError
from plcemu.base.spans import Span
from plcemu.base.time import format_duration
from plcemu.engine.resource import State
from plcemu.engine.tracer import Access, Event
from plcemu.io.exchange import MEMORY
from plcemu.runtime.causes import LEAVES, Cause
from plcemu.runtime.cycle import Cycle
from plcemu.runtime.debugger import ScanTrace
from plcemu.runtime.history import History, HistoryError
from plcemu.runtime.past import Past

DEPTH = 6
"""How many causes deep an explanation goes by default."""

NODES = 2_000
"""The largest number of values that one explanation shows; beyond it branches end, and say so."""

LIBRARY = "library/"
"""What the names of the sources of standard function blocks begin with."""


class Why:
    """Explains the values of a recorded run.

    Args:
        history: of the run.
        bench: a cycle of the same program, on which past scans are executed again. It stands
            somewhere in the past afterwards.
    """

    def __init__(self, history: History, bench: Cycle) -> None:
        self._history = history
        self._bench = bench
        self._memory = bench.resource.memory
        self._past = Past(history, bench)
        self._names = {self._memory.place(i)[0]: tag.name
                       for i, tag in enumerate(self._memory.tags)}
        self._steps = {tag.name for tag in self._memory.tags if tag.name.endswith(".X")
                       and tag.name[:-1] + "T" in self._memory.tags}

    def explain(self, tag: str, scan: int | None = None, depth: int = DEPTH) -> Cause:
        """Explain the value that a tag had after a scan; by default after the last one.

        Raises:
            HistoryError: the scan is not in the history, or nothing was executed.
            PlcemuError: a depth below 1.
            UnknownNameError: there is no such tag.
        """
        if depth < 1:
            raise PlcemuError(f"found a depth of {depth}, expected 1 or more")
        index = self._index(tag)
        last = self._history.executed_before(self._history.end_scan if scan is None else scan + 1)
        if last is None:
            raise HistoryError("no scan has been executed that could explain a value")
        if index >= len(self._memory.tags):
            return self._fact(index, last)
        offset, row = self._memory.place(index)
        image = self._past.after(last)
        access = Access(offset, image[offset:offset + row.size], self._memory.tags[index].name,
                        row.unpack(image, offset))
        self._seen: set[tuple[int, int, int]] = set()
        self._nodes = 0
        return self._cause(access, last, None, depth)

    def scan_at(self, t_ns: int) -> int:
        """Return the scan whose values hold at an instant.

        Raises:
            HistoryError: it is not in the history, or lies ahead.
        """
        end = self._history.executed_before(self._history.end_scan)
        if end is None or t_ns < 0:
            raise HistoryError(f"no scan was executed up to {format_duration(t_ns)}")
        scan = self._history.scan_at(t_ns + 1) - 1
        if scan >= self._history.end_scan:
            raise HistoryError(f"{format_duration(t_ns)} lies ahead: the record ends with scan "
                               f"{end}, released at "
                               f"{format_duration(self._history.released_ns(end))}")
        return scan

    def _index(self, tag: str) -> int:
        try:
            return self._bench.tags.find(tag)
        except UnknownNameError:
            wanted = tag.strip().upper()
            for index, each in enumerate(self._memory.tags):
                if wanted.startswith("%") and each.address.upper() == wanted:
                    return index
            raise

    def _fact(self, index: int, last: int) -> Cause:
        """Return the leaf of a value that no instruction makes."""
        tag = self._bench.tags[index]
        self._past.after(last)
        self._history.execute(self._bench, last, last)
        what = "of the plant" if tag.name.startswith("plant.") else \
            "judged from the tags of its property" if tag.name.startswith("monitor.") else \
            "of the runtime"
        return Cause(tag.name, self._bench.values()[index], "fact",
                     self._history.released_ns(last), last,
                     note=f"{what}: {tag.comment}" if tag.comment else what)

    # ------------------------------------------------------------ one value

    def _cause(self, access: Access, scan: int, before: int | None, depth: int) -> Cause:
        """Return the cause of memory as it stood before an event of a scan; None: after it all."""
        place = range(access.address, access.address + len(access.data))
        trace = self._past.trace(scan)
        since_ns = self._since(place, scan, access.data)
        writer = _last_writer(trace, place, before)
        if writer is None and not self._past.came_in(scan, place):
            earlier = self._past.changed(place, scan)
            if earlier is None:
                return self._oldest(access)
            scan, trace, before = earlier, self._past.trace(earlier), None
            writer = _last_writer(trace, place, None)
        cause = self._new(access, "input", scan, since_ns)
        if writer is None and self._past.is_clock(place):
            return self._elapsed(cause, access, before, depth)
        if writer is None or not self._agrees(trace, writer, access, before):
            cause.kind, cause.note = self._from_outside(access, scan, place)
            return cause
        self._nodes += 1
        self._written(cause, trace, writer)
        key = (scan, writer, access.address)
        if access.name and key in self._seen:
            cause.kind = "seen"
        elif depth <= 1 or self._nodes > NODES:
            cause.kind = "depth"
        else:
            self._seen.add(key)
            cause.causes = self._causes(trace, writer, access, scan, depth - 1)
            if not cause.causes:
                cause.kind = "initial" if cause.kind == "step" else "constant"
        return cause

    def _elapsed(self, cause: Cause, access: Access, before: int | None, depth: int) -> Cause:
        """Explain a time that passes: a step's, by the step."""
        cause.kind, cause.note = "clock", "the time that has passed"
        flag = access.name.rpartition(".")[0] + ".X"
        if flag in self._steps and depth > 1:
            offset, row = self._memory.place(self._memory.tags.find(flag))
            image = self._past.trace(cause.scan).memory_before(before) if before is not None \
                else self._past.after(cause.scan)
            read = Access(offset, image[offset:offset + row.size], flag, row.unpack(image, offset))
            cause.note = "the time since the step was entered"
            cause.causes = [self._cause(read, cause.scan, before, depth - 1)]
        return cause

    def _agrees(self, trace: ScanTrace, writer: int, access: Access, before: int | None) -> bool:
        """Whether the value is what the instruction wrote: forces and safe values come after it."""
        if before is not None:
            return True
        return any(each.address <= access.address < each.address + len(each.data)
                   and (each.address != access.address or each.data == access.data)
                   for each in trace.events[writer].writes)

    def _written(self, cause: Cause, trace: ScanTrace, writer: int) -> None:
        """Say where and how a value was written."""
        place, inside = _users_place(trace.events, writer)
        cause.kind = "block" if inside else "step" if cause.tag in self._steps else "assignment"
        if place is not None:
            cause.file, (cause.line, _) = place.source.name, place.source.position(place.start)
            cause.text = _source_line(place)
        if inside and cause.tag.rpartition(".")[2].upper() in ("Q", "ET"):
            cause.note = self._timer(cause.tag.rpartition(".")[0], cause.scan)

    def _timer(self, instance: str, scan: int) -> str:
        """Return how a timer stood after a scan; empty for a block that is none."""
        found = {}
        image = self._past.after(scan)
        for part in ("PT", "ET"):
            if f"{instance}.{part}" not in self._memory.tags:
                return ""
            offset, row = self._memory.place(self._memory.tags.find(f"{instance}.{part}"))
            value = row.unpack(image, offset)
            assert isinstance(value, int)
            found[part] = format_duration(value)
        return f"timer: ET {found['ET']} of PT {found['PT']}"

    def _causes(self, trace: ScanTrace, writer: int, access: Access, scan: int,
                depth: int) -> list[Cause]:
        """Return what an instruction's reads come from, each tag once, in order of the text."""
        inside = _is_library(trace.events[writer])
        found: dict[str, Cause] = {}
        visited: set[tuple[int, int]] = set()
        for read, n in self._named(trace, writer, scan, visited):
            if inside and not self._counts(read, access):
                continue
            if read.name not in found:
                found[read.name] = self._cause(read, *n, depth)
        return list(found.values())

    def _counts(self, read: Access, access: Access) -> bool:
        """Whether a read inside a standard function block is shown: of inputs, and of what is held.

        Its outputs are written within it, its inputs by the caller.
        """
        own, _, part = read.name.rpartition(".")
        if own != access.name.rpartition(".")[0]:
            return True
        if read.name == access.name:
            return read.data == access.data
        return part.upper() not in ("Q", "Q1", "QU", "QD", "ET", "CV", "BUSY")

    def _named(self, trace: ScanTrace, writer: int, scan: int, visited: set[tuple[int, int]]
               ) -> Iterator[tuple[Access, tuple[int, int]]]:
        """Yield the tags that a write depends on, with scan and event of the read.

        Memory without a name is looked through to what was stored there.
        """
        if (scan, writer) in visited:
            return
        visited.add((scan, writer))
        for n in sorted(self._past.reads(scan).get(writer, ())):
            for read in trace.events[n].reads:
                if read.name:
                    yield read, (scan, n)
                else:
                    yield from self._through(read, scan, n, visited)

    def _through(self, read: Access, scan: int, before: int, visited: set[tuple[int, int]]
                 ) -> Iterator[tuple[Access, tuple[int, int]]]:
        place = range(read.address, read.address + len(read.data))
        if self._past.is_clock(place):
            return
        trace = self._past.trace(scan)
        writer = _last_writer(trace, place, before)
        if writer is None:
            earlier = self._past.changed(place, scan)
            if earlier is None:
                return
            scan, trace = earlier, self._past.trace(earlier)
            writer = _last_writer(trace, place, None)
        if writer is not None:
            yield from self._named(trace, writer, scan, visited)

    # ------------------------------------------------------------ where it ends

    def _since(self, place: range, scan: int, data: bytes) -> int | None:
        """Return since when memory has held a value, seen from inside a scan."""
        if self._past.before(scan)[place.start:place.stop] != data:
            return self._history.released_ns(scan)
        changed = self._past.changed(place, scan)
        return self._history.released_ns(changed) if changed is not None else \
            0 if self._history.first_scan == 0 else None

    def _oldest(self, access: Access) -> Cause:
        """Return the leaf of a value that is older than all that is recorded."""
        if self._history.first_scan > 0:
            return self._new(access, "record", self._past.first, None)
        return self._new(access, "initial", self._past.first, 0)

    def _new(self, access: Access, kind: str, scan: int, since_ns: int | None) -> Cause:
        tags = self._memory.tags
        value = access.value.hex() if isinstance(access.value, bytes) else access.value
        of = tags[access.name].type if access.name in tags else ""
        return Cause(access.name, value, kind, self._history.released_ns(scan), scan, since_ns,
                     type=of)

    def _from_outside(self, access: Access, scan: int, place: range) -> tuple[str, str]:
        """Return the kind of a leaf that no instruction wrote, and who wrote it."""
        if any(offset in place for offset in self._past.forces(scan)):
            return "forced", "forced to this value"
        if self._past.state(scan) is not State.RUN:
            return "safe", f"a safe value: the PLC is in {self._past.state(scan).value}"
        address = self._address(access)
        writers = [w.port for w in self._history.writes_of(scan)
                   if (w.area == MEMORY and w.offset < place.stop
                       and place.start < w.offset + len(w.data))
                   or (w.area != MEMORY and _covers(w.area, w.offset, len(w.data), address))]
        if writers:
            return "input", f"written by {writers[-1]}" + (f" at {address}" if address else "")
        if address.startswith("%I"):
            return "input", f"written by {self._driver(scan, address)} at {address}"
        return "restart", LEAVES["restart"]

    def _driver(self, scan: int, address: str) -> str:
        """Return who drives an input that no client wrote: the plant, or a scenario."""
        plant = self._bench.plant
        if plant is not None and any(str(point.address).upper() == address.upper()
                                     for point in plant.coupling.inputs):
            return "the plant"
        return ", ".join(sorted(self._past.writers(scan) - {"plant"})) or "outside"

    def _address(self, access: Access) -> str:
        return self._memory.tags[access.name].address if access.name in self._memory.tags else ""


def _covers(area: str, offset: int, count: int, address: str) -> bool:
    """Whether a write to an area touches the element that an address names."""
    if not address:
        return False
    at = parse_address(address)
    first = at.index // 8 if area[1] == "X" else at.index * SIZES[area[1]]
    return at.area == area and offset <= first < offset + count


def _last_writer(trace: ScanTrace, place: range, before: int | None) -> int | None:
    """Return the last event that wrote into memory, of those before another."""
    end = len(trace.events) if before is None else before
    for n in range(end - 1, -1, -1):
        for access in trace.events[n].writes:
            if access.address < place.stop and place.start < access.address + len(access.data):
                return n
    return None


def _is_library(event: Event) -> bool:
    span = event.instr.span
    return span is not None and span.source.name.startswith(LIBRARY)


def _users_place(events: Sequence[Event], n: int) -> tuple[Span | None, bool]:
    """Return where the user wrote what an event does, and whether it is in a standard block.

    Of a standard function block that is its call.
    """
    inside, depth = _is_library(events[n]), events[n].depth
    for event in reversed(events[:n + 1]):
        if event.depth <= depth and (event.depth < depth or event is events[n]) \
                and event.instr.span is not None and not _is_library(event):
            return event.instr.span, inside
        if event.depth < depth:
            depth = event.depth
    return None, inside


def _source_line(span: Span) -> str:
    text = span.source.text
    begin = text.rfind("\n", 0, span.start) + 1
    end = text.find("\n", span.start)
    return " ".join(text[begin:end if end >= 0 else len(text)].split())
