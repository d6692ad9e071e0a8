"""A resource's tasks as they run: when they are released, what they execute, what is measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from plcemu.base.errors import PlcemuError
from plcemu.engine.engines import Code, Engine
from plcemu.engine.jitter import Jitter, JitteredReleases
from plcemu.engine.releases import Releases
from plcemu.engine.statistics import TaskStatistics
from plcemu.ir.program import Instance, Program, Task


@dataclass(slots=True)
class TaskState:
    """A task as it runs.

    A task with an event and an interval has two of these, with the same statistics: one that looks
    for the event, and one that is periodic while the trigger is FALSE.

    Attributes:
        task: what it is.
        releases: when it is due; of an event, when it is looked for.
        code: its programs, ready to run.
        statistics: what is measured of it.
        looks_for_event: whether a rising edge is what lets it run.
        quiet: its next run would change nothing but elapsed times, as the last one did.
        still: its next run would change nothing at all.
    """

    task: Task
    releases: Releases | JitteredReleases
    code: Code
    statistics: TaskStatistics = field(default_factory=TaskStatistics)
    looks_for_event: bool = False
    quiet: bool = False
    still: bool = False


def prepare(program: Program, tasks: Sequence[Task], cycle_ns: int, engine: Engine,
            budget: int, jitter: Jitter | None = None) -> list[TaskState]:
    """Return tasks ready to run, the most urgent first; of equal ones the first named.

    Args:
        program: whose instances they run.
        tasks: what they are.
        cycle_ns: the interval of tasks that name none, and how often events are looked for.
        engine: what runs them.
        budget: of tasks that name none.
        jitter: of periodic tasks; None: none.

    Raises:
        PlcemuError: two tasks of one name, an interval or a budget that is not positive, a program
            that does not exist.
    """
    prepared = []
    names: set[str] = set()
    for task in sorted(tasks, key=lambda t: t.priority):
        _check(task, cycle_ns, names)
        instances = [_instance(program, task, name) for name in task.programs]
        code = engine.prepare([(i.function, i.base) for i in instances], task.budget or budget)
        statistics = TaskStatistics()
        looks = Releases(task.phase_ns, cycle_ns)
        if task.event:
            prepared.append(TaskState(task, looks, code, statistics, looks_for_event=True))
        if task.interval_ns or not task.event:
            releases = _releases(task, task.interval_ns or cycle_ns, jitter)
            prepared.append(TaskState(task, releases, code, statistics))
    return prepared


def _releases(task: Task, step: int, jitter: Jitter | None) -> Releases | JitteredReleases:
    if jitter is None:
        return Releases(task.phase_ns, step)
    return JitteredReleases(task.phase_ns, step, jitter, task.name)


def _check(task: Task, cycle_ns: int, names: set[str]) -> None:
    interval = task.interval_ns or cycle_ns
    if min(interval, cycle_ns if task.event else interval) <= 0 or task.phase_ns < 0:
        raise PlcemuError(f"task {task.name}: the interval must be positive, the phase not "
                          "negative")
    if task.budget < 0 or task.watchdog_ns < 0:
        raise PlcemuError(f"task {task.name}: budget and watchdog must not be negative")
    if task.name.casefold() in names:
        raise PlcemuError(f"there are two tasks {task.name}")
    names.add(task.name.casefold())


def _instance(program: Program, task: Task, name: str) -> Instance:
    try:
        return program.instance(name)
    except KeyError as missing:
        known = ", ".join(i.name for i in program.instances)
        raise PlcemuError(f"task {task.name}: there is no program {missing}; "
                          f"there is {known}") from None
