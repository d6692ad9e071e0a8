"""The debugger: a PLC stepped by scan, by step of its charts, by line and by instruction.

A scan is executed as a whole before it is looked at: nobody outside ever sees half of one. Where
somebody wants to look inside, the tasks are run again on the interpreter over the memory that they
found, which gives every instruction with what it read and wrote, and the same result. So the place
inside a scan is a cursor in the trace of that scan, and going back is as cheap as going on.
"""

from __future__ import annotations

import contextlib
import enum
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import PurePath
from types import TracebackType
from typing import NamedTuple, Self

from plcemu.base.errors import (
    CompileError,
    PlcemuError,
    ProgramFault,
    UnknownNameError,
    did_you_mean,
)
from plcemu.base.spans import Diagnostic, Span
from plcemu.base.time import DurationError, parse_duration_ns
from plcemu.base.types import Value
from plcemu.engine.engines import Code
from plcemu.engine.resource import State
from plcemu.engine.tracer import Event, Tracer
from plcemu.ir.program import Task
from plcemu.monitor.bind import Binder, StateFunction
from plcemu.monitor.formula import is_state
from plcemu.monitor.parse import parse_formula
from plcemu.runtime.access import TagAccess
from plcemu.runtime.cycle import Cycle
from plcemu.runtime.history import History, HistoryError

Line = tuple[str, int]
"""A source's name and a line in it, from 1."""


class DebugError(PlcemuError):
    """A place, tag or command that the debugger cannot take."""


class Why(enum.Enum):
    """Why the debugger stopped."""

    STEP = "step"
    BREAKPOINT = "breakpoint"
    WATCH = "watch"
    FAULT = "fault"
    LIMIT = "limit"


class Stop(NamedTuple):
    """Where the debugger stopped.

    Attributes:
        why: the reason.
        text: the breakpoint, the watched tag with its values, or the fault.
        scan: the number of the scan, looked at or next.
        t_ns: its release.
        event: the instruction that comes next; None between two scans.
    """

    why: Why
    text: str
    scan: int
    t_ns: int
    event: Event | None


@dataclass(slots=True)
class ScanTrace:
    """What happened inside one scan.

    Attributes:
        scan: its number.
        t_ns: its release.
        events: its instructions.
        images: the memory that a task found, by the number of its first event.
    """

    scan: int
    t_ns: int
    events: list[Event] = field(default_factory=list)
    images: list[tuple[int, bytes]] = field(default_factory=list)

    def memory_before(self, n: int) -> bytes:
        """Return the memory before the event number `n`; of their number on, after the last."""
        begin, image = next((b, i) for b, i in reversed(self.images) if b <= n)
        block = bytearray(image)
        for event in self.events[begin:n]:
            for access in event.writes:
                block[access.address:access.address + len(access.data)] = access.data
        return bytes(block)

    def writers(self, name: str) -> list[Event]:
        """Return the instructions that wrote a tag, in order."""
        wanted = name.casefold()
        return [e for e in self.events if any(a.name.casefold() == wanted for a in e.writes)]


class Debugger:
    """Steps a PLC in virtual time; a context manager, since it holds on to the resource.

    Args:
        target: a `Plc`, a `System`, or a cycle.

    Attributes:
        cycle: of the target.
        history: of the target; one is begun if there is none.
        trace: of the last scan that was looked into; None if none was.
        breakpoints: their texts, as given.
        watches: full names of the watched tags.
    """

    def __init__(self, target: object) -> None:
        cycle = getattr(target, "cycle", target)
        if not isinstance(cycle, Cycle):
            raise TypeError(f"a Plc or a System can be debugged, not {target!r}")
        self.cycle = cycle
        recorder = cycle.recorder
        self.history = recorder if isinstance(recorder, History) else History(cycle)
        self.access = TagAccess(cycle.resource.memory, cycle.exchange, "debugger")
        self.trace: ScanTrace | None = None
        self.breakpoints: dict[str, Callable[[Event, bool], bool]] = {}
        self.watches: list[str] = []
        self._at: int | None = None
        self._wanted = False
        self._tracing: ScanTrace | None = None
        resource = cycle.resource
        self._tracer = Tracer(resource.program, resource.memory)
        self._lines = sorted({line for function in resource.program.functions.values()
                              for i in function.code if (line := _line(i.span)) is not None})
        self._steps = [i for i, tag in enumerate(resource.memory.tags) if tag.name.endswith(".X")
                       and tag.type == "BOOL"]
        resource.probe = self._probe

    def close(self) -> None:
        """Let go of the resource, which goes on as before."""
        self.cycle.resource.probe = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()

    # ------------------------------------------------------------ executing

    def _probe(self, task: Task, code: Code) -> None:
        """Run a task; if its scan is looked into, run it again from the same memory, traced."""
        block = self.cycle.resource.memory.block
        before = bytes(block)
        failed: ProgramFault | None = None
        try:
            code.run()
        except ProgramFault as fault:
            failed = fault
        if self._tracing is not None and (self._wanted or failed
                                          or self._differ(before, bytes(block))):
            block[:] = before
            self._tracing.images.append((len(self._tracing.events), before))
            instances = [self.cycle.resource.program.instance(name) for name in task.programs]
            self._tracing.events.extend(self._tracer.events(
                [(i.function, i.base) for i in instances], task.name, code.budget))
        elif failed:
            raise failed

    def _differ(self, before: bytes, after: bytes) -> bool:
        """Whether a watched tag has another value in another image."""
        for name in self.watches:
            offset, row = self.cycle.resource.memory.place(self.cycle.tags.find(name))
            if before[offset:offset + row.size] != after[offset:offset + row.size]:
                return True
        return False

    def _lap(self, traced: bool) -> ScanTrace:
        """Execute one scan; what lies ahead in the record is done again, if nothing was changed."""
        cycle = self.cycle
        tracing = self._tracing = ScanTrace(cycle.scan_number, cycle.t_ns)
        self._wanted = traced
        try:
            if cycle.scan_number < self.history.end_scan and self.history.is_untouched:
                self.history.replay(cycle.scan_number + 1)
            else:
                cycle.lap()
        finally:
            self._tracing, self._wanted = None, False
        self._at = None
        if tracing.events:
            self.trace = tracing
        return tracing

    # ------------------------------------------------------------ where it stands

    @property
    def event(self) -> Event | None:
        """The instruction that comes next; None between two scans."""
        return self.trace.events[self._at] if self._at is not None and self.trace else None

    def here(self) -> Stop:
        """Return where the debugger stands."""
        return self._stop()

    def _stop(self, why: Why = Why.STEP, text: str = "") -> Stop:
        inside = self.trace if self._at is not None else None
        scan, t_ns = (inside.scan, inside.t_ns) if inside else \
            (self.cycle.scan_number, self.cycle.t_ns)
        return Stop(why, text, scan, t_ns, self.event)

    def _go_to(self, n: int) -> None:
        """Put the cursor before an event of the scan; behind the last one is between two scans."""
        assert self.trace is not None
        self._at = n if n < len(self.trace.events) else None

    def read(self, name: str) -> Value:
        """Return a tag's value before the instruction that comes next.

        Raises:
            UnknownNameError: there is no such tag.
        """
        memory, tags = self.cycle.resource.memory, self.cycle.tags
        try:
            index = tags.find(name)
        except UnknownNameError:
            return self.access.read(name)
        if index >= len(memory.tags):
            value = self.cycle.values()[index]
            assert value is not None, "without field links all values are known"
            return value
        if self._at is None or self.trace is None:
            return memory.read(index)
        offset, row = memory.place(index)
        return row.unpack(self.trace.memory_before(self._at), offset)

    # ------------------------------------------------------------ breakpoints

    def break_at(self, place: str) -> str:
        """Set a breakpoint at a line (`12`, `main.st:12`), or at the beginning of a POU or action.

        Returns:
            The place in full.

        Raises:
            DebugError: there is no code there.
        """
        text, condition = self._place(place.strip())
        self.breakpoints[text] = condition
        return text

    def _place(self, place: str) -> tuple[str, Callable[[Event, bool], bool]]:
        file, _, number = place.rpartition(":")
        if number.isdigit():
            line = self._line_of(place, file, int(number))
            return f"{line[0]}:{line[1]}", lambda event, new_line: new_line and event.line == line
        functions = self.cycle.resource.program.functions
        found = next((f for f in functions if f.casefold() == place.casefold()), None)
        if found is None:
            raise DebugError(f"{place!r} is no line and no POU with code"
                             f"{did_you_mean(place, functions)}; write file:line, a line, a POU or "
                             "POU.ACTION")
        return found, lambda event, new_line: event.function == found and event.pc == 0

    def _line_of(self, place: str, file: str, number: int) -> Line:
        main = self.cycle.resource.program.instances[0].function
        own = next((line[0] for i in self.cycle.resource.program.functions[main].code
                    if (line := _line(i.span)) is not None), "")
        lines = [line for line in self._lines
                 if (_names(line[0], file) if file else line[0] == own)]
        if not lines:
            names = ", ".join(sorted({line[0] for line in self._lines}))
            raise DebugError(f"{place!r}: no code comes from {file}; it comes from {names}")
        exact = [line for line in lines if line[1] == number]
        if not exact:
            nearest = min(lines, key=lambda line: (abs(line[1] - number), line))
            raise DebugError(f"{place!r}: there is no code at this line; the nearest is "
                             f"{nearest[0]}:{nearest[1]}")
        return exact[0]

    def watch(self, name: str) -> str:
        """Stop whenever a tag of the program changes; returns its full name.

        Raises:
            UnknownNameError: there is no such tag.
        """
        memory = self.cycle.resource.memory
        full = memory.tags[memory.tags.find(name)].name
        if full not in self.watches:
            self.watches.append(full)
        return full

    def clear(self, what: str | None = None) -> None:
        """End a breakpoint or watch, by the text that setting it returned; None: all of them.

        Raises:
            DebugError: there is no such one.
        """
        if what is None:
            self.breakpoints.clear()
            self.watches.clear()
        elif what in self.breakpoints:
            del self.breakpoints[what]
        elif what in self.watches:
            self.watches.remove(what)
        else:
            raise DebugError(f"there is no breakpoint or watch {what!r}; there is "
                             f"{', '.join([*self.breakpoints, *self.watches]) or 'none'}")

    # ------------------------------------------------------------ inside a scan

    def step(self, n: int = 1) -> Stop:
        """Go on by instructions; from between two scans, to the first instruction of the next."""
        for _ in range(n):
            if self._at is None:
                if not self._enter():
                    return self._ran_nothing()
            else:
                self._go_to(self._at + 1)
        return self._stop()

    def next(self) -> Stop:
        """Go on to the next line, over calls; at the end of the scan, between two scans."""
        if self._at is None:
            return self.step()
        assert self.trace is not None
        here = self.trace.events[self._at]
        for n in range(self._at + 1, len(self.trace.events)):
            event = self.trace.events[n]
            if event.depth <= here.depth and event.line is not None and (
                    event.line != here.line or event.activation != here.activation):
                self._go_to(n)
                return self._stop()
        self._at = None
        return self._stopped_at_end()

    def step_back(self, n: int = 1) -> Stop:
        """Go back by instructions, within the scan."""
        if self._at is None:
            if self.trace is None or self.trace.scan != self.cycle.scan_number - 1:
                raise DebugError("the debugger stands between two scans, and did not look into the "
                                 "last one; go back by a scan and step into it")
            self._at = len(self.trace.events)
        self._at = max(0, self._at - n)
        return self._stop()

    def _enter(self) -> bool:
        """Execute a scan and stand before its first instruction, if it has one."""
        if not self._lap(traced=True).events:
            return False
        self._at = 0
        return True

    # ------------------------------------------------------------ scans

    def scan(self, n: int = 1) -> Stop:
        """End the scan looked at, or execute one; then so many more, to between two scans.

        A breakpoint, a watch or a fault stops it before.
        """
        begin = self.cycle.scan_number - (self._at is not None)
        return self._run(lambda: self.cycle.scan_number >= begin + n, Why.STEP)

    def chart(self, limit: int = 1_000_000) -> Stop:
        """Execute scans until a step of a chart is entered or left, at most so many.

        Raises:
            DebugError: the program has no charts.
        """
        if not self._steps:
            raise DebugError("the program has no steps")
        before, begin = self._flags(), self.cycle.scan_number
        stop = self._run(lambda: self._flags() != before or
                         self.cycle.scan_number >= begin + limit, Why.STEP)
        if stop.why is not Why.STEP:
            return stop
        after, tags = self._flags(), self.cycle.tags
        moved = [f"{tags[i].name.removesuffix('.X')} {'entered' if now else 'left'}"
                 for i, was, now in zip(self._steps, before, after, strict=True) if was != now]
        return stop._replace(text=", ".join(moved)) if moved else stop._replace(why=Why.LIMIT)

    def _flags(self) -> list[Value]:
        return [self.cycle.resource.memory.read(i) for i in self._steps]

    def run(self, until_ns: int | None = None, limit: int = 1_000_000) -> Stop:
        """Execute scans until something stops it: at the latest an instant, or so many scans."""
        begin = self.cycle.scan_number
        return self._run(lambda: (until_ns is not None and self.cycle.t_ns >= until_ns)
                         or self.cycle.scan_number >= begin + limit, Why.LIMIT)

    def _run(self, is_over: Callable[[], bool], why: Why) -> Stop:
        if self._at is not None:
            if (stop := self._look(self._at + 1)) is not None:
                return stop
            self._at = None
            if self.cycle.resource.state is State.FAULT:
                return self._stopped_at_end()
        while not is_over():
            before = self._watched()
            was = self.cycle.resource.state
            self._lap(traced=bool(self.breakpoints))
            if (stop := self._look(0, before)) is not None:
                return stop
            if self.cycle.resource.state is State.FAULT is not was:
                return self._stopped_at_end()
        return self._stop(why)

    def until(self, condition: str, limit: int = 1_000_000) -> Stop:
        """Execute scans until a condition over the tags holds after one, such as `n > 3`.

        Args:
            condition: a state formula of the property language, or an instant such as `2s`.
            limit: the largest number of scans.

        Raises:
            CompileError: it is no formula over the tags.
            DebugError: it says more than one instant can tell.
        """
        with contextlib.suppress(DurationError):
            return self.run(parse_duration_ns(condition), limit)
        holds, begin = self._condition(condition), self.cycle.scan_number
        values: list[Value | None] = self.cycle.values()

        def is_over() -> bool:
            nonlocal values
            before, values = values, self.cycle.values()
            return self.cycle.scan_number > begin and bool(holds(values, before))

        stop = self._run(lambda: is_over() or self.cycle.scan_number >= begin + limit, Why.STEP)
        return stop._replace(text=condition) if stop.why is Why.STEP else stop

    def _condition(self, text: str) -> StateFunction:
        formula, found = parse_formula(text), list[Diagnostic]()
        if not is_state(formula):
            raise DebugError(f"{text!r} speaks of more than one instant; compare tags, as in n > 3")
        binder = Binder(self.cycle.tags, found)
        known = binder.check(formula)
        if found:
            raise CompileError(found)
        return binder.compile(known).holds

    def _watched(self) -> dict[str, Value]:
        memory = self.cycle.resource.memory
        return {name: memory.read(memory.tags.find(name)) for name in self.watches}

    def _look(self, begin: int, before: dict[str, Value] | None = None) -> Stop | None:
        """Look for a reason to stop in the scan just executed, from an event on."""
        traced = self.trace is not None and self.trace.scan == self.cycle.scan_number - 1
        for n, reason in self._reasons(begin) if traced else ():
            self._go_to(n)
            return self._stop(*reason)
        for name, old in (before or {}).items():
            new = self._watched()[name]
            if repr(new) != repr(old):
                return self._stop(Why.WATCH, f"{name}: {old!r} -> {new!r}")
        return None

    def _reasons(self, begin: int) -> Iterator[tuple[int, tuple[Why, str]]]:
        """Yield where breakpoints are met, and where watched tags were given another value."""
        assert self.trace is not None
        lines: dict[int, Line | None] = {}
        values = self._values_before(self.trace)
        for n, event in enumerate(self.trace.events):
            new_line = event.line is not None and lines.get(event.activation) != event.line
            lines[event.activation] = event.line or lines.get(event.activation)
            hits = [text for text, meets in self.breakpoints.items() if meets(event, new_line)]
            if n >= begin and (hits or event.fault):
                yield n, (Why.FAULT, event.fault) if event.fault else \
                    (Why.BREAKPOINT, ", ".join(hits))
            for access in event.writes:
                if access.name in values and repr(values[access.name]) != repr(access.value):
                    old, values[access.name] = values[access.name], access.value
                    if n + 1 > begin:
                        yield n + 1, (Why.WATCH, f"{access.name}: {old!r} -> {access.value!r}")

    def _values_before(self, trace: ScanTrace) -> dict[str, Value | bytes]:
        memory, image = self.cycle.resource.memory, trace.memory_before(0)
        places = {name: memory.place(memory.tags.find(name)) for name in self.watches}
        return {name: row.unpack(image, offset) for name, (offset, row) in places.items()}

    def _stopped_at_end(self) -> Stop:
        fault = self.cycle.resource.fault
        return self._stop(Why.FAULT, str(fault)) if fault else self._stop()

    def _ran_nothing(self) -> Stop:
        """Stop behind a scan without an instruction: no task was due, or none runs at all."""
        stop = self._stopped_at_end()
        return stop if stop.text else stop._replace(text="the scan executed no instruction")

    def back(self, n: int = 1) -> Stop:
        """Go back to the beginning of the scan looked at, or so many scans, by time travel.

        Raises:
            HistoryError: the history does not reach so far.
        """
        target = self.cycle.scan_number - n
        if target < self.history.first_scan:
            raise HistoryError(f"{n} scans back is before scan {self.history.first_scan}, where "
                               "the record begins")
        self.history.rewind(target)
        self._at = self.trace = None
        return self._stop()


def _line(span: Span | None) -> Line | None:
    return None if span is None else (span.source.name, span.source.position(span.start)[0])


def _names(source: str, file: str) -> bool:
    """Whether a file's name, perhaps without its folders, names a source."""
    wanted = PurePath(file).parts
    return PurePath(source).parts[-len(wanted):] == wanted
