"""Which program instances run in which tasks (IEC 61131-3, 2.7.1 and 2.7.2)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from plcemu.base.errors import did_you_mean
from plcemu.base.spans import Span
from plcemu.ir.program import Event, Task
from plcemu.lang import syntax as s
from plcemu.lang.constants import NotConstant, fold
from plcemu.lang.emitter import Emitter
from plcemu.lang.frames import Functions
from plcemu.lang.image import Image
from plcemu.lang.report import Report
from plcemu.lang.scope import Scope
from plcemu.lang.types import BOOL, BlockType, Place

DEFAULT_TASK = "main"
LOWEST_PRIORITY = 65536
"""Of programs without a task, which run after all others (2.7.2, rule 4)."""


@dataclass(frozen=True, slots=True)
class Planned:
    """A program instance to be: its name, its PROGRAM's scope and, if declared, its declaration."""

    name: str
    scope: Scope
    declaration: s.ProgramInstance | None = None


class Planner:
    """Finds the instances and tasks of all configurations.

    Args:
        units: what is declared.
        scopes: of the POUs.
        globals_: the scope of the global variables; cells of events are added to it.
        image: the process image.
        report: takes the mistakes.
    """

    def __init__(self, units: Iterable[s.Unit], scopes: list[Scope], globals_: Scope, image: Image,
                 report: Report) -> None:
        self._programs = {x.pou.name.upper(): x for x in scopes if x.pou.kind == "PROGRAM"}
        self._configurations = [c for unit in units for c in unit.configurations]
        self._globals, self._image, self._report = globals_, image, report

    def plan(self) -> tuple[list[Planned], tuple[Task, ...]]:
        """Return the program instances and the tasks.

        Without a CONFIGURATION each PROGRAM has one instance of its name, in one task.
        """
        self._note_several()
        declared = [p for c in self._configurations for p in c.programs]
        if not declared:
            instances = [Planned(x.pou.name, x) for x in self._programs.values()]
            return instances, (Task(DEFAULT_TASK, programs=tuple(i.name for i in instances)),)
        instances, by_task = self._instances(declared)
        return instances, self._tasks(by_task)

    def _note_several(self) -> None:
        for second in self._configurations[1:]:
            self._report.error("P0090", second.span, "several configurations are not supported "
                               "yet; give each a text of its own")
        for configuration in self._configurations:
            for span in configuration.resources[1:]:
                self._report.warning("P0090", span, "several resources are not supported yet: all "
                                     "tasks run in one, by their priorities")

    def _instances(self, declared: list[s.ProgramInstance],
                   ) -> tuple[list[Planned], dict[tuple[str, str], list[str]]]:
        known = {_key(t.resource, t.name) for c in self._configurations for t in c.tasks}
        instances: dict[str, Planned] = {}
        by_task: dict[tuple[str, str], list[str]] = {}
        for each in declared:
            scope = self._programs.get(each.type.upper())
            if scope is None:
                hint = did_you_mean(each.type, list(self._programs)).removeprefix("; ")
                self._report.error("P0022", each.type_span, f"there is no PROGRAM {each.type!r}",
                                   hint)
                continue
            if each.name.upper() in instances:
                self._report.error("P0021", each.span, f"{each.name!r} is declared twice")
                continue
            key = _key(each.resource, each.task)
            if each.task and key not in known:
                hint = did_you_mean(each.task, [task for _, task in known]).removeprefix("; ")
                self._report.error("P0020", each.span, f"there is no TASK {each.task!r}", hint)
            instances[each.name.upper()] = Planned(each.name, scope, each)
            by_task.setdefault(key if each.task else ("", ""), []).append(each.name)
        return list(instances.values()), by_task

    # ------------------------------------------------------------ tasks

    def _tasks(self, by_task: dict[tuple[str, str], list[str]]) -> tuple[Task, ...]:
        tasks: list[Task] = []
        resources: list[str] = []
        seen: set[tuple[str, str]] = set()
        for configuration in self._configurations:
            for task in configuration.tasks:
                key = _key(task.resource, task.name)
                if key in seen:
                    self._report.error("P0021", task.span, f"there is another TASK {task.name!r}")
                    continue
                seen.add(key)
                programs = tuple(by_task.pop(key, ()))
                if not programs:
                    self._report.warning("P0058", task.span,
                                         f"no program runs in TASK {task.name!r}")
                tasks.append(self._task(task, programs))
                resources.append(task.resource)
        tasks = _with_names_of_their_own(tasks, resources)
        left = by_task.pop(("", ""), [])
        if left:
            taken = {task.name.casefold() for task in tasks}
            name = DEFAULT_TASK
            while name in taken:
                name += "_"
            tasks.append(Task(name, 0, LOWEST_PRIORITY, 0, tuple(left)))
        return tuple(tasks)

    def _task(self, task: s.TaskDeclaration, programs: tuple[str, ...]) -> Task:
        settings: dict[str, int] = {}
        event: Event | None = None
        for key, expr, span in task.settings:
            if key == "SINGLE":
                event = self._event(task, expr)
            elif key in ("INTERVAL", "PRIORITY"):
                settings[key] = self._setting(key, expr, span)
            else:
                self._report.error("P0010", span,
                                   f"a TASK has INTERVAL, PRIORITY and SINGLE, not {key}")
        return Task(task.name, settings.get("INTERVAL", 0), settings.get("PRIORITY", 0), 0,
                    programs, event)

    def _setting(self, key: str, expr: s.Expr, span: Span) -> int:
        try:
            value = fold(expr, self._globals.lookup)
        except NotConstant as problem:
            self._report.error("P0027", problem.span, problem.reason)
            return 0
        of_the_other_kind = isinstance(expr, s.Literal) \
            and (expr.kind == "time") != (key == "INTERVAL")
        if isinstance(value, bool) or not isinstance(value, int) or value < 0 or of_the_other_kind:
            self._report.error("P0025", span, "an interval is a duration and a priority a number, "
                               "not negative")
            return 0
        return value

    def _event(self, task: s.TaskDeclaration, expr: s.Expr) -> Event | None:
        """Return the event whose rising edge releases a task, or None after a reported mistake."""
        if not isinstance(expr, s.Name | s.Direct):
            self._report.error("P0027", expr.span, "SINGLE takes a global variable or an address, "
                               "whose rising edge releases the task")
            return None
        place = self._global_place(expr)
        if place is None:
            return None
        if place.type != BOOL or place.path:
            self._report.error("P0023", expr.span, f"SINGLE takes a BOOL variable, this is "
                               f"{place.type.name}")
            return None
        of = self._globals.type
        seen = of.add(f"__seen_{task.resource}_{task.name}", BOOL).offset
        of.size = -(-of.size // 8) * 8
        return Event(place.offset, -(-self._image.size // 8) * 8 + seen)

    def _global_place(self, expr: s.Name | s.Direct) -> Place | None:
        resources = {c.name.upper() for c in self._configurations} \
            | {r.upper() for c in self._configurations for r in c.resource_names}
        out = Emitter(self._globals, self._image.offset, self._report, "", "", Functions([], 0))
        return out.place(without_resource(expr, self._globals, resources))


def without_resource(expr: s.Name | s.Direct, globals_: Scope,
                     resources: set[str]) -> s.Name | s.Direct:
    """Return a reference to a global variable without the resource's name in front of it."""
    if not isinstance(expr, s.Name) or len(expr.parts) < 2 or expr.head.upper() not in resources \
            or not isinstance(expr.parts[1], str):
        return expr
    place = globals_.find(expr.head.upper())
    has_fields = place is not None and isinstance(place.type, BlockType)
    return expr if has_fields else s.Name(expr.span, expr.parts[1:])


def _with_names_of_their_own(tasks: Sequence[Task], resources: Sequence[str]) -> list[Task]:
    """Put the resource before the name of tasks that several resources call the same."""
    counts = Counter(task.name.casefold() for task in tasks)
    return [replace(task, name=f"{resource}.{task.name}")
            if counts[task.name.casefold()] > 1 else task
            for task, resource in zip(tasks, resources, strict=True)]


def _key(resource: str, task: str) -> tuple[str, str]:
    return resource.upper(), task.upper()
