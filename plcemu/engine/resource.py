"""The resource: one PLC's processor with its tasks, its state and its safe outputs.

Knows no clock: it is told the instant of each release and runs what is due.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from plcemu.base.areas import SIZES
from plcemu.base.errors import PlcemuError, ProgramFault
from plcemu.base.types import Value
from plcemu.engine.engines import Code, make_engine
from plcemu.engine.interpreter import BUDGET
from plcemu.engine.memory import Memory
from plcemu.ir.program import Program, Task


class State(enum.Enum):
    """The states of a resource. Outputs are at their safe values except in RUN."""

    RUN = "RUN"
    STOP = "STOP"
    FAULT = "FAULT"


class Checkpoint(NamedTuple):
    """The whole state of a resource between two scans.

    Attributes:
        memory: the memory block.
        state: RUN, STOP or FAULT.
        fault: why it is in FAULT.
        last_ns: the instant of the last scan; None before the first.
    """

    memory: bytes
    state: State
    fault: ProgramFault | None
    last_ns: int | None


@dataclass(slots=True)
class _TaskState:
    """A task as it runs: its instances' code, and whether its last scan changed nothing.

    A task with an event and an interval has two of these: one that looks for the event, and one
    that is periodic while the trigger is FALSE.
    """

    task: Task
    interval_ns: int
    code: Code
    looks_for_event: bool = False
    quiet: bool = False


class Resource:
    """Runs a program's tasks on one memory block.

    Args:
        program: the compiled program.
        cycle_ns: the interval of tasks that name none.
        engine: one of `plcemu.engine.engines.ENGINES`.
        tasks: instead of the program's own.
        safe_outputs: values of output tags while not in RUN; all others are 0 or FALSE.
        budget: instructions that jumps backwards may cost in one run of a task.

    Raises:
        PlcemuError: an unknown engine, an interval that is not positive, a task of no program, a
            safe output that is no tag or whose value does not fit it.
    """

    def __init__(self, program: Program, cycle_ns: int, engine: str = "auto",
                 tasks: Sequence[Task] | None = None,
                 safe_outputs: Mapping[str, Value] | None = None, budget: int = BUDGET) -> None:
        self.program = program
        self.engine = make_engine(engine, program, budget)
        self.memory = Memory(program.layout, self.engine.block)
        self.state = State.RUN
        self.fault: ProgramFault | None = None
        self._tasks = self._prepare(program, tasks or program.tasks, cycle_ns)
        self._safe = self._safe_places(safe_outputs or {})
        self._last_ns: int | None = None
        self._left = bytes(self.memory.block)

    def _prepare(self, program: Program, tasks: Sequence[Task], cycle_ns: int) -> list[_TaskState]:
        prepared = []
        for task in sorted(tasks, key=lambda t: t.priority):
            interval = task.interval_ns or cycle_ns
            if min(interval, cycle_ns if task.event else interval) <= 0 or task.phase_ns < 0:
                raise PlcemuError(f"task {task.name}: the interval must be positive, the phase "
                                  "not negative")
            try:
                instances = [program.instance(name) for name in task.programs]
            except KeyError as missing:
                known = ", ".join(i.name for i in program.instances)
                raise PlcemuError(f"task {task.name}: there is no program {missing}; "
                                  f"there is {known}") from None
            code = self.engine.prepare([(i.function, i.base) for i in instances])
            if task.event:
                prepared.append(_TaskState(task, cycle_ns, code, looks_for_event=True))
            if task.interval_ns or not task.event:
                prepared.append(_TaskState(task, interval, code))
        return prepared

    def _safe_places(self, values: Mapping[str, Value]) -> list[tuple[int, bytes]]:
        """Return what to write into memory for safe outputs: zeros, then the configured values."""
        zeros = [(e.offset, bytes(e.count * SIZES[e.area[1]]))
                 for e in self.program.layout.extents if e.area[0] == "Q"]
        chosen = []
        for name, value in values.items():
            offset, row = self.memory.place(self.memory.tags.find(name))
            try:
                chosen.append((offset, row.pack(value)))
            except ValueError as problem:
                raise PlcemuError(f"safe output {name}: {problem}") from None
        return zeros + chosen

    # ------------------------------------------------------------ state

    def cold_start(self) -> None:
        """Set memory to its initial values and go to RUN."""
        self.memory.cold_start()
        self.fault, self.state = None, State.RUN
        self._wake()

    def stop(self) -> None:
        """Go to STOP: nothing runs, outputs take their safe values."""
        self.state = State.STOP
        self._make_safe()

    def resume(self) -> None:
        """Go to RUN with memory as it is (a warm start)."""
        self.fault, self.state = None, State.RUN
        self._wake()

    def _make_safe(self) -> None:
        for offset, data in self._safe:
            self.memory.block[offset:offset + len(data)] = data

    # ------------------------------------------------------------ scan

    @property
    def tasks(self) -> list[Task]:
        """The tasks, the most urgent first."""
        return list(dict.fromkeys(state.task for state in self._tasks))

    def is_due(self, t_ns: int) -> bool:
        """Whether any task is released at an instant."""
        return any(_is_due(state, t_ns) for state in self._tasks)

    def first_release_ns(self, not_before_ns: int) -> int:
        """Return the first instant, not before another, at which a task is released."""
        return min(_first_release(state, not_before_ns) for state in self._tasks)

    def last_release_ns(self, before_ns: int) -> int:
        """Return the last instant before another at which a task is released; -1 if none is."""
        return max(_last_release(state, before_ns) for state in self._tasks)

    def releases_between(self, first_ns: int, before_ns: int) -> int:
        """Return how many instants in [first, before) release a task."""
        if len(self._tasks) == 1:
            state = self._tasks[0]
            return _count_before(state, before_ns) - _count_before(state, first_ns)
        count, t_ns = 0, self.first_release_ns(first_ns)
        while t_ns < before_ns:
            count, t_ns = count + 1, self.first_release_ns(t_ns + 1)
        return count

    def scan(self, t_ns: int) -> None:
        """Let time pass up to an instant, then run the tasks released at it, by priority."""
        elapsed = 0 if self._last_ns is None else max(0, t_ns - self._last_ns)
        self._last_ns = t_ns
        if self.state is not State.RUN:
            self._make_safe()
            return
        if bytes(self.memory.block) != self._left or (elapsed and self.engine.clocks_run()):
            self._wake()
        if elapsed:
            self.engine.advance_clocks(elapsed)
        for state in self._tasks:
            if not _is_due(state, t_ns):
                continue
            if not self._is_wanted(state):
                state.quiet = True
            elif not self._run(state, t_ns):
                break
        self._left = bytes(self.memory.block)

    def _is_wanted(self, state: _TaskState) -> bool:
        """Whether a task is to run at its release: always, unless it has an event (table 50)."""
        event = state.task.event
        if event is None:
            return True
        block = self.memory.block
        trigger, before = block[event.trigger], block[event.seen]
        if not state.looks_for_event:
            return not trigger
        if trigger != before:
            block[event.seen] = trigger
            self._wake()
        return trigger > before

    def _run(self, state: _TaskState, t_ns: int) -> bool:
        before = bytes(self.memory.block)
        try:
            state.code.run()
        except ProgramFault as fault:
            self.fault = ProgramFault(fault.reason, task=state.task.name, pou=fault.pou,
                                      place=fault.place, t_ns=t_ns)
            self.state = State.FAULT
            self._make_safe()
            return False
        if bytes(self.memory.block) != before:
            self._wake()
        else:
            state.quiet = True
        return True

    def _wake(self) -> None:
        for state in self._tasks:
            state.quiet = False

    def is_quiet(self) -> bool:
        """Whether scans at later releases would change nothing while the inputs stay as they are.

        So it is when every task's last scan changed no byte, nobody else has changed one since,
        and no clock that the program reads runs. In STOP and FAULT nothing runs.
        """
        if self.state is not State.RUN:
            return True
        return all(state.quiet for state in self._tasks) \
            and bytes(self.memory.block) == self._left and not self.engine.clocks_run()

    def inputs_changed(self) -> None:
        """Tell that memory was written from outside, so that scans matter again."""
        self._wake()

    def checkpoint(self) -> Checkpoint:
        """Return the whole state, to which a resource of the same program can return."""
        return Checkpoint(self.memory.snapshot(), self.state, self.fault, self._last_ns)

    def return_to(self, point: Checkpoint) -> None:
        """Take up the state of a checkpoint."""
        self.memory.restore(point.memory)
        self.state, self.fault, self._last_ns = point.state, point.fault, point.last_ns
        self._wake()

    def snapshot(self) -> bytes:
        """Return the whole state as bytes; it holds no absolute time."""
        return self.memory.snapshot()

    def restore(self, image: bytes) -> None:
        """Set the whole state and go to RUN; raises `ValueError` for another program's image."""
        self.memory.restore(image)
        self.resume()


def _is_due(state: _TaskState, t_ns: int) -> bool:
    since = t_ns - state.task.phase_ns
    return since >= 0 and since % state.interval_ns == 0


def _first_release(state: _TaskState, not_before_ns: int) -> int:
    since = max(0, not_before_ns - state.task.phase_ns)
    return state.task.phase_ns + -(-since // state.interval_ns) * state.interval_ns


def _last_release(state: _TaskState, before_ns: int) -> int:
    since = before_ns - 1 - state.task.phase_ns
    return state.task.phase_ns + since // state.interval_ns * state.interval_ns if since >= 0 \
        else -1


def _count_before(state: _TaskState, t_ns: int) -> int:
    """Return how many releases of a task lie before an instant."""
    since = t_ns - state.task.phase_ns
    return max(0, -(-since // state.interval_ns))
