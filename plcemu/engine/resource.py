"""The resource: one PLC's processor with its tasks, its state and its safe outputs.

Knows no clock: it is told the instant of each release and runs what is due. Who wants to know how
long tasks take hands it one to read.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from plcemu.base.areas import SIZES
from plcemu.base.errors import PlcemuError, ProgramFault
from plcemu.base.time import format_duration
from plcemu.base.types import Value
from plcemu.engine.engines import Code, make_engine
from plcemu.engine.interpreter import BUDGET
from plcemu.engine.jitter import Jitter
from plcemu.engine.memory import Memory
from plcemu.engine.tasks import TaskState, prepare
from plcemu.engine.timetable import together
from plcemu.ir.program import Event, Program, Task
from plcemu.ir.shape import match


class State(enum.Enum):
    """The states of a resource. Outputs are at their safe values except in RUN."""

    RUN = "RUN"
    STOP = "STOP"
    FAULT = "FAULT"


Probe = Callable[[Task, Code], None]
"""Runs a task's code in its own way; raises `ProgramFault`."""


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


class Rest(NamedTuple):
    """How long scans cannot matter.

    Attributes:
        still: they would change nothing at all; else elapsed times that the program does not read.
        until_ns: the instant at which the passing of time alone changes what they do; None: never.
    """

    still: bool
    until_ns: int | None


_UNKNOWN = -1


class Resource:
    """Runs a program's tasks on one memory block.

    Args:
        program: the compiled program.
        cycle_ns: the interval of tasks that name none.
        engine: one of `plcemu.engine.engines.ENGINES`.
        tasks: instead of the program's own.
        safe_outputs: values of output tags while not in RUN; all others are 0 or FALSE.
        jitter: of periodic tasks; None: none.
        budget: of tasks that name none: instructions that jumps backwards may cost in one run.

    Raises:
        PlcemuError: an unknown engine, an interval that is not positive, a task of no program, two
            tasks of one name, a safe output that is no tag or whose value does not fit it.
    """

    def __init__(self, program: Program, cycle_ns: int, engine: str = "auto",
                 tasks: Sequence[Task] | None = None,
                 safe_outputs: Mapping[str, Value] | None = None, budget: int = BUDGET,
                 jitter: Jitter | None = None) -> None:
        self.program = program
        self.engine = make_engine(engine, program, budget)
        self.memory = Memory(program.layout, self.engine.block)
        self.state = State.RUN
        self.fault: ProgramFault | None = None
        self._tasks = prepare(program, tasks or program.tasks, cycle_ns, self.engine, budget,
                              jitter)
        self.tasks = list(dict.fromkeys(state.task for state in self._tasks))
        """The tasks, the most urgent first."""
        self.statistics = list({s.task: s.statistics for s in self._tasks}.values())
        """What is measured of each of `tasks`, in their order."""
        self._releases = together(state.releases for state in self._tasks)
        self._safe = self._safe_places(safe_outputs or {})
        self.probe: Probe | None = None
        """Who is asked to run the tasks instead, such as a debugger; None for nobody."""
        self._last_ns: int | None = None
        # What the last scan left in memory, and how much time may pass then (or `_UNKNOWN`).
        self._left = bytes(self.memory.block)
        self._within: int | None = _UNKNOWN

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

    def stop(self) -> None:
        """Go to STOP, from FAULT too: nothing runs, outputs take their safe values."""
        self.state = State.STOP
        self._make_safe()

    def resume(self) -> None:
        """Go to RUN with memory as it is; no time has passed for its clock cells meanwhile."""
        self.fault, self.state = None, State.RUN
        self._wake()

    def restart(self, cold: bool) -> None:
        """Go to RUN from the beginning; the next scan is a first scan (IEC 61131-3, 2.4.2).

        In a cold restart every variable gets its initial value; in a warm one the retained
        variables keep theirs. Inputs stay what the world last made them.
        """
        layout, block, before = self.memory.layout, self.memory.block, self.memory.snapshot()
        self.memory.cold_start()
        for extent in layout.extents:
            if extent.area[0] == "I":
                end = extent.offset + extent.count * SIZES[extent.area[1]]
                block[extent.offset:end] = before[extent.offset:end]
        if not cold:
            match(layout.retained, layout.retained).carry(before, block)
        self._last_ns = None
        self.resume()

    def _make_safe(self) -> None:
        for offset, data in self._safe:
            self.memory.block[offset:offset + len(data)] = data

    # ------------------------------------------------------------ releases

    def is_due(self, t_ns: int) -> bool:
        """Whether any task is released at an instant."""
        return self._releases.is_due(t_ns)

    def first_release_ns(self, not_before_ns: int) -> int:
        """Return the first instant, not before another, at which a task is released."""
        return self._releases.first(not_before_ns)

    def last_release_ns(self, before_ns: int) -> int:
        """Return the last instant before another at which a task is released; -1 if none is."""
        return self._releases.last(before_ns)

    def releases_between(self, first_ns: int, before_ns: int) -> int:
        """Return how many instants in [first, before) release a task."""
        return self._releases.count(first_ns, before_ns)

    # ------------------------------------------------------------ scan

    def scan(self, t_ns: int, now_ns: Callable[[], int] | None = None) -> None:
        """Let time pass up to an instant, then run the tasks released at it, by priority.

        Args:
            t_ns: the instant.
            now_ns: a clock by which executions are measured, in real time; None measures nothing
                and notes instead whether the scans to come can matter.
        """
        elapsed = 0 if self._last_ns is None else max(0, t_ns - self._last_ns)
        self._last_ns = t_ns
        if self.state is not State.RUN:
            self._make_safe()
            return
        if now_ns is not None:
            run = self._run_measured(now_ns)
            self._wake()
        else:
            run = self._run_compared
            if bytes(self.memory.block) != self._left:
                self._wake()
            elif elapsed:
                self._expect(elapsed)
        if elapsed:
            self.engine.advance_clocks(elapsed)
        if now_ns is None:
            self._left, self._within = bytes(self.memory.block), _UNKNOWN
        for state in self._tasks:
            if state.releases.is_due(t_ns):
                if state.task.event is None or self._is_wanted(state.task.event, state):
                    run(state, t_ns)
                else:
                    state.quiet = state.still = True
                if self.state is not State.RUN:
                    break

    def _is_wanted(self, event: Event, state: TaskState) -> bool:
        """Whether a task with an event is to run at its release (table 50)."""
        block = self.memory.block
        trigger, before = block[event.trigger], block[event.seen]
        if not state.looks_for_event:
            return not trigger
        if trigger != before:
            block[event.seen] = trigger
            self._left = bytes(block)
            self._wake()
        return trigger > before

    def _run(self, state: TaskState, t_ns: int) -> None:
        state.statistics.scans += 1
        try:
            if self.probe is None:
                state.code.run()
            else:
                self.probe(state.task, state.code)
        except ProgramFault as fault:
            self._fail(ProgramFault(fault.reason, task=state.task.name, pou=fault.pou,
                                    place=fault.place, t_ns=t_ns))

    def _run_measured(self, now_ns: Callable[[], int]) -> Callable[[TaskState, int], None]:
        def run(state: TaskState, t_ns: int) -> None:
            begin = now_ns()
            self._run(state, t_ns)
            took = now_ns() - begin
            state.statistics.lateness.add(begin - t_ns)
            state.statistics.execution.add(took)
            self._watch(state.task, took, t_ns)
        return run

    def _watch(self, task: Task, took_ns: int, t_ns: int) -> None:
        """End in FAULT what took longer than the task's watchdog allows."""
        if 0 < task.watchdog_ns < took_ns and self.state is State.RUN:
            self._fail(ProgramFault(
                f"the task took {format_duration(took_ns)}, its watchdog allows "
                f"{format_duration(task.watchdog_ns)}", task=task.name, t_ns=t_ns))

    def _fail(self, fault: ProgramFault) -> None:
        self.fault, self.state = fault, State.FAULT
        self._make_safe()

    # ------------------------------------------------------------ scans that cannot matter

    def _time_matters_in_ns(self) -> int | None:
        """Return how much time may pass before that alone can change what a scan does.

        Memory must be as the last scan left it.
        """
        if self._within == _UNKNOWN:
            memory = self.memory
            self._within = memory.time_matters_in_ns() \
                if memory.reads_clocks and self.engine.clocks_run() else None
        return self._within

    def _expect(self, elapsed_ns: int) -> None:
        """Wake the tasks if so much time can change what they do."""
        within = self._time_matters_in_ns()
        if within is not None:
            for state in self._tasks:
                state.still = False
                state.quiet = state.quiet and elapsed_ns < within

    def _run_compared(self, state: TaskState, t_ns: int) -> None:
        """Run a task; note whether that changed anything, and whether more than elapsed times."""
        before = self._left
        self._run(state, t_ns)
        after = self._left = bytes(self.memory.block)
        if after == before:
            state.quiet = state.still = True
            return
        only_elapsed = self.memory.differ_in_elapsed_only(before, after)
        for each in self._tasks:
            each.still = False
            each.quiet = each.quiet and only_elapsed
        state.quiet = only_elapsed

    def _wake(self) -> None:
        for state in self._tasks:
            state.quiet = state.still = False

    def rest(self) -> Rest | None:
        """Return how long scans cannot matter while the inputs stay as they are; None: not at all.

        They cannot matter while every task's last run changed no byte, or only elapsed times that
        the program does not read, nobody else has changed one since, and no clock runs that the
        program reads; of clocks of which it sees only the expiry that matters. In STOP and FAULT
        nothing runs.
        """
        if self.state is not State.RUN:
            return Rest(True, None)
        still = True
        for task in self._tasks:
            if not task.quiet:
                return None
            still = still and task.still
        if bytes(self.memory.block) != self._left:
            return None
        within = self._time_matters_in_ns()
        if within is None:
            return Rest(still, None)
        return Rest(False, (self._last_ns or 0) + within) if within else None

    def is_quiet(self) -> bool:
        """Whether scans at later releases would change nothing while the inputs stay so."""
        rest = self.rest()
        return rest is not None and rest.still

    def last_of_each_ns(self, first_ns: int, before_ns: int) -> int:
        """Return the first of the tasks' last releases in [first, before), or `before`.

        Who passes over scans that only show elapsed times stops there, so that each task has shown
        what it would have shown last.
        """
        lasts = (state.releases.last(before_ns) for state in self._tasks)
        return min((t for t in lasts if t >= first_ns), default=before_ns)

    def missed(self, first_ns: int, before_ns: int) -> None:
        """Count the releases in [first, before), which an overrun let pass, for each task."""
        for task, statistics in zip(self.tasks, self.statistics, strict=True):
            lost = together(s.releases for s in self._tasks if s.task is task).count(
                first_ns, before_ns)
            statistics.missed += lost
            statistics.overruns += lost > 0

    def pass_over(self, first_ns: int, before_ns: int) -> int:
        """Count the runs in [first, before) that are not made because they change nothing.

        Returns:
            How many instants in [first, before) release a task.
        """
        releases = self._releases
        passed = releases.count(first_ns, before_ns)
        for state in self._tasks if self.state is State.RUN else ():
            event = state.task.event
            if event is None or not (state.looks_for_event or self.memory.block[event.trigger]):
                state.statistics.scans += passed if state.releases is releases else \
                    state.releases.count(first_ns, before_ns)
        return passed

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

    def succeed(self, other: Resource) -> None:
        """Stand in for another resource, of an edited program, from the next scan on.

        What is measured of a task goes on if there is a task of that name.
        """
        self.state, self.fault, self._last_ns = other.state, other.fault, other._last_ns
        before = {task.name.casefold(): each
                  for task, each in zip(other.tasks, other.statistics, strict=True)}
        for state in self._tasks:
            state.statistics = before.get(state.task.name.casefold(), state.statistics)
        self.statistics = list({s.task: s.statistics for s in self._tasks}.values())
        self._wake()

    def snapshot(self) -> bytes:
        """Return the whole state as bytes; it holds no absolute time."""
        return self.memory.snapshot()

    def restore(self, image: bytes) -> None:
        """Set the whole state and go to RUN; raises `ValueError` for another program's image."""
        self.memory.restore(image)
        self.resume()
