"""The PLC as a Python object: synchronous, in virtual time, without sockets."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Self, TypeAlias

from plcemu.base.errors import UnknownNameError
from plcemu.base.tags import TagTable
from plcemu.base.time import parse_duration_ns
from plcemu.base.trace import Trace
from plcemu.base.types import Value
from plcemu.engine.interpreter import BUDGET
from plcemu.engine.resource import Resource
from plcemu.ir.program import Program, Task
from plcemu.lang.compile import compile_program
from plcemu.runtime.access import TagAccess
from plcemu.runtime.causes import Cause
from plcemu.runtime.change import Change, ChangeReport, make_exchange
from plcemu.runtime.cycle import Cycle
from plcemu.runtime.debugger import Debugger
from plcemu.runtime.history import LIMIT_BYTES, Difference, History, HistoryError, differences
from plcemu.runtime.retention import KeptInStep
from plcemu.runtime.why import DEPTH, Why


def compile(source: str | Path | Iterable[str | Path], *,
            final_scan: bool = False, single_firing: bool = False) -> Program:
    """Compile a program text, a file or several files.

    Args:
        source: what to compile.
        final_scan: whether the actions of charts run once more in the scan in which they end.
        single_firing: whether Signal Interpreted Petri Nets fire once in a scan, instead of until
            they are stable.

    Raises:
        CompileError: with every mistake in `diagnostics`.
    """
    return compile_program(source, final_scan=final_scan, single_firing=single_firing)


PlcState: TypeAlias = "bytes | int | Plc"
"""A state to compare: a snapshot, the number of a recorded scan, or a PLC as it stands."""


class Plc:
    """A PLC at its cold start, `t_ns == 0`, in virtual time.

    Args:
        program: compiled, or a text or Path to compile.
        cycle: the interval of tasks that name none, such as `"10ms"`, or ns.
        engine: `auto`, `wasm` or `interpreter`.
        record: keep a `trace`, and a history to travel in.
        history: whether to keep a history without a trace, or how many bytes it may take; then
            the oldest scans are forgotten (`history.LIMIT_BYTES` by default).
        tasks: instead of the program's own.
        safe_outputs: values of outputs while not in RUN; all others are 0 or FALSE.
        budget: instructions that jumps backwards may cost in one run of a task; one that needs more
            has run away and ends in FAULT.
        retain: a file that keeps the retained variables: they are taken over from it, and it is up
            to date whenever `scan`, `run_for`, `stop`, `resume`, `restart` or `change` returns.

    Raises:
        CompileError: the program text is wrong.
        PlcemuError: an unknown engine, a cycle or budget that is not positive; the retained
            variables cannot be kept (later too).
    """

    def __init__(self, program: Program | str | Path, cycle: str | int = "10ms",
                 engine: str = "auto", *, record: bool = False, history: bool | int = False,
                 tasks: Sequence[Task] | None = None,
                 safe_outputs: Mapping[str, Value] | None = None, budget: int = BUDGET,
                 retain: str | Path | None = None) -> None:
        compiled = program if isinstance(program, Program) else compile_program(program)
        self._arguments = (compiled, parse_duration_ns(cycle), engine, tasks, safe_outputs, budget)
        self._resource = Resource(*self._arguments)
        self._kept = None if retain is None else KeptInStep(Path(retain), self._resource)
        self._exchange = make_exchange(self._resource)
        self._cycle = Cycle(self._resource, self._exchange)
        self._access = TagAccess(self._resource.memory, self._exchange, "python")
        self._trace = Trace(self._cycle.tags) if record else None
        if self._trace is not None:
            self._cycle.observers.append(self._trace)
        self.earlier_traces: list[Trace] = []
        """Recordings that an online change ended."""
        limit = LIMIT_BYTES if history is True or (record and history is False) else history
        self._history = History(self._cycle, limit) if limit is not False else None

    # ------------------------------------------------------------ values

    def __getitem__(self, name: str) -> Value:
        try:
            return self._access.read(name)
        except UnknownNameError:
            if name not in self.tags:
                raise
        value = self._cycle.values()[self.tags.find(name)]
        assert value is not None, "a PLC without field links knows all its values"
        return value

    def __setitem__(self, name: str, value: Value) -> None:
        self._access.write(name, value)

    def force(self, name: str, value: Value) -> None:
        """Hold a tag at a value until `unforce`, whoever else writes it."""
        self._access.force(name, value)
        self._resource.inputs_changed()

    def unforce(self, name: str) -> None:
        """End a tag's force."""
        self._access.unforce(name)
        self._resource.inputs_changed()

    @property
    def cycle(self) -> Cycle:
        """What executes its laps."""
        return self._cycle

    @property
    def tags(self) -> TagTable:
        """The tag table."""
        return self._cycle.tags

    # ------------------------------------------------------------ time

    @property
    def t_ns(self) -> int:
        """The instant of the next release, in ns since the start."""
        return self._cycle.t_ns

    def scan(self, n: int = 1) -> None:
        """Execute releases, one by default: latch, scan what is due, publish; then time goes on."""
        for _ in range(n):
            self._cycle.lap()
        self._keep()

    def run_for(self, duration: str | int) -> None:
        """Execute all releases of the next stretch of time, such as `"2s"`, or ns."""
        self._cycle.run_virtual(self.t_ns + parse_duration_ns(duration))
        self._keep()

    def debug(self) -> Debugger:
        """Return a debugger at work on this PLC, which stands between two scans."""
        return Debugger(self.cycle)

    # ------------------------------------------------------------ state

    @property
    def state(self) -> str:
        """`RUN`, `STOP` or `FAULT`."""
        return self._resource.state.value

    @property
    def fault(self) -> str:
        """Why the PLC is in FAULT, or empty."""
        return str(self._resource.fault or "")

    def stop(self) -> None:
        """Go to STOP; outputs take their safe values."""
        self._cycle.stop()
        self._keep()

    def resume(self) -> None:
        """Go from STOP or FAULT to RUN, with memory as it is."""
        self._cycle.resume()
        self._keep()

    def restart(self, cold: bool = False) -> None:
        """Begin anew, from any state: the next scan is a first scan.

        A warm restart keeps the values of retained variables; in a cold one all are initial.
        """
        self._cycle.restart(cold)
        self._keep()

    # ------------------------------------------------------------ an edited program

    def change(self, program: Program | str | Path) -> ChangeReport:
        """Load an edited program between two scans; what it still has keeps its value.

        A recording begins anew if the edited program has other tags; what was recorded so far is
        in `earlier_traces`. A history always does: the past belongs to the old program.

        Raises:
            CompileError: the program text is wrong; the PLC goes on as it was.
            PlcemuError: tasks or safe outputs do not fit it; the PLC goes on as it was.
        """
        compiled = program if isinstance(program, Program) else compile_program(program)
        arguments = (compiled, *self._arguments[1:])
        change = Change(self._cycle, Resource(*arguments), self._cycle.suite.properties)
        trace = self.trace if self._trace is not None else None
        report = change.apply()
        self._arguments, self._resource = arguments, change.resource
        self._access = TagAccess(self._resource.memory, self._exchange, "python")
        if trace is not None and report.is_recorded_anew:
            self.earlier_traces.append(trace)
            self._cycle.observers.remove(trace)
            self._trace = Trace(self._cycle.tags)
            self._cycle.observers.append(self._trace)
        if self._history is not None:
            self._history = History(self._cycle, self._history.limit_bytes)
        self._keep()
        return report

    def retained(self) -> dict[str, Value]:
        """Return the values of the retained tags, by their full names."""
        memory = self._resource.memory
        places = [(v.offset, v.offset + v.size) for v in self._resource.program.layout.retained]
        return {tag.name: memory.read(n) for n, tag in enumerate(memory.tags)
                if any(begin <= memory.place(n)[0] < end for begin, end in places)}

    @property
    def retain_problems(self) -> list[str]:
        """What was wrong with the file of the retained variables, and what did not fit."""
        return self._kept.problems if self._kept is not None else []

    def _keep(self) -> None:
        if self._kept is not None:
            self._kept.keep(self._resource)

    def snapshot(self) -> bytes:
        """Return the whole state of the program; it holds no absolute time."""
        return self._resource.snapshot()

    def restore(self, image: bytes) -> None:
        """Set the whole state of the program; raises `ValueError` for another program's image."""
        self._resource.restore(image)
        self._exchange.update_outputs()

    def fork(self, scan: int | None = None) -> Self:
        """Return an independent PLC in the same state, or in the one before a recorded scan.

        Raises:
            HistoryError: the scan is not in the history.
        """
        compiled, cycle_ns, engine, tasks, safe_outputs, budget = self._arguments
        limit = self._history.limit_bytes if self._history is not None else False
        twin = type(self)(compiled, cycle_ns, engine, record=self._trace is not None,
                          history=limit, tasks=tasks, safe_outputs=safe_outputs, budget=budget)
        if scan is None or scan == self.scan_number:
            twin._cycle.return_to(self._cycle.checkpoint())
            twin._access.repeat(self._access)
        else:
            self.history.place(twin._cycle, scan)
        twin._cycle.tell_all()
        return twin

    # ------------------------------------------------------------ time travel

    @property
    def scan_number(self) -> int:
        """The number of the next scan, from 0."""
        return self._cycle.scan_number

    @property
    def history(self) -> History:
        """The recorded past; raises `HistoryError` unless the PLC was made to keep one."""
        if self._history is None:
            raise HistoryError("nothing is recorded; make the PLC with record=True or history=True")
        return self._history

    def rewind(self, scan: int | None = None, *, t_ns: int | None = None) -> None:
        """Return to where the PLC stood before a scan, or before the first one from an instant on.

        Memory, image, forces and state are as the scan found them; writes that waited for it are
        not repeated. The trace is cut there. The scans from there on can be replayed until others
        take their place.

        Raises:
            HistoryError: it is not in the history.
            TypeError: neither or both are given.
        """
        if (scan is None) is (t_ns is None):
            raise TypeError("rewind takes a scan number or t_ns=…, one of the two")
        history = self.history
        target = history.scan_at(t_ns) if t_ns is not None else scan
        assert target is not None
        history.rewind(target)

    def replay(self, until_scan: int | None = None) -> None:
        """Execute the recorded scans again, with their writes, forces and commands.

        Args:
            until_scan: the scan before which to stop; by default the end of the record.

        Raises:
            HistoryError: the scan is not recorded, or the PLC was changed since the rewind.
        """
        self.history.replay(until_scan)

    def why(self, tag: str, at: str | int | None = None, depth: int = DEPTH) -> Cause:
        """Explain a tag's value: the instructions, steps, timers and inputs that made it so.

        Args:
            tag: its name, or an address that a variable of the program has.
            at: an instant that is recorded, such as `"2.5s"`, or ns; by default after the last
                scan.
            depth: how many causes deep.

        Raises:
            HistoryError: nothing is recorded, or the instant is not.
            UnknownNameError: there is no such tag.
        """
        why = Why(self.history, self.fork().cycle)
        return why.explain(tag, None if at is None else why.scan_at(parse_duration_ns(at)), depth)

    def diff(self, old: PlcState, new: PlcState | None = None) -> list[Difference]:
        """Return the tags of the program that differ between two states, in order of the table.

        A state is a snapshot, the number of a recorded scan, or a PLC of the same program.

        Args:
            old: the one state.
            new: the other; by default this PLC as it stands.

        Raises:
            HistoryError: a scan is not in the history.
            ValueError: a snapshot of another program.
        """
        return differences(self._resource.memory, self._state_of(old),
                           self._state_of(self if new is None else new))

    def _state_of(self, state: PlcState) -> bytes:
        if isinstance(state, Plc):
            return state.snapshot()
        if isinstance(state, int):
            return self.fork(state).snapshot()
        return state

    @property
    def trace(self) -> Trace:
        """The recorded trace; raises `ValueError` unless the PLC was made with `record=True`."""
        if self._trace is None:
            raise ValueError("nothing is recorded; make the PLC with record=True")
        self._trace.end_ns = self._cycle.end_ns
        return self._trace
