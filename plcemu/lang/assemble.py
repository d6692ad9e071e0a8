"""Putting a program together: instances, tasks, and the layout of memory with its tags."""

from __future__ import annotations

from collections.abc import Iterable

from plcemu.base.areas import Address
from plcemu.base.spans import Span
from plcemu.base.tags import Tag
from plcemu.base.types import ElementaryType, StringType
from plcemu.ir.program import ClockCell, Layout, Slot, Task
from plcemu.lang import syntax as s
from plcemu.lang.constants import NotConstant, fold
from plcemu.lang.frames import Functions
from plcemu.lang.image import Image
from plcemu.lang.report import Report
from plcemu.lang.scope import Declarations, Scope
from plcemu.lang.types import (
    TYPE_OF_SIZE,
    BlockType,
    EnumType,
    SubrangeType,
    Type,
    clocks,
    default_bytes,
    leaves,
)

_DEFAULT_TASK = "main"


def plan_instances(units: Iterable[s.Unit], scopes: list[Scope],
                   report: Report) -> tuple[list[tuple[str, Scope]], tuple[Task, ...]]:
    """Return the program instances by name, and the tasks.

    Without a CONFIGURATION each PROGRAM has one instance of its name, in one task.
    """
    programs = {x.pou.name.upper(): x for x in scopes if x.pou.kind == "PROGRAM"}
    configurations = [c for unit in units for c in unit.configurations]
    declared = [p for c in configurations for p in c.programs]
    if not declared:
        instances = [(x.pou.name, x) for x in programs.values()]
        return instances, (Task(_DEFAULT_TASK, programs=tuple(n for n, _ in instances)),)
    instances = []
    by_task: dict[str, list[str]] = {}
    for each in declared:
        scope = programs.get(each.type.upper())
        if scope is None:
            report.error("P0022", each.type_span, f"there is no PROGRAM {each.type!r}")
            continue
        if any(each.name.upper() == name.upper() for name, _ in instances):
            report.error("P0021", each.span, f"{each.name!r} is declared twice")
            continue
        instances.append((each.name, scope))
        by_task.setdefault(each.task.upper(), []).append(each.name)
    return instances, _tasks(configurations, by_task, declared, report)


def _tasks(configurations: list[s.Configuration], by_task: dict[str, list[str]],
           declared: list[s.ProgramInstance], report: Report) -> tuple[Task, ...]:
    tasks = []
    known = {task.name.upper() for c in configurations for task in c.tasks}
    for each in declared:
        if each.task and each.task.upper() not in known:
            report.error("P0020", each.span, f"there is no TASK {each.task!r}")
    for configuration in configurations:
        for task in configuration.tasks:
            programs = tuple(by_task.pop(task.name.upper(), ()))
            tasks.append(_task(task, programs, report))
    left = by_task.pop("", [])
    if left:
        tasks.append(Task(_DEFAULT_TASK, 0, 65536, 0, tuple(left)))
    return tuple(tasks)


def _task(task: s.TaskDeclaration, programs: tuple[str, ...], report: Report) -> Task:
    settings: dict[str, int] = {}
    for key, expr, span in task.settings:
        if key not in ("INTERVAL", "PRIORITY"):
            code = "P0090" if key == "SINGLE" else "P0010"
            report.error(code, span, f"{key} of a TASK is not supported yet" if code == "P0090"
                         else f"a TASK has INTERVAL, PRIORITY and SINGLE, not {key}")
            continue
        settings[key] = _setting(expr, span, report)
    return Task(task.name, settings.get("INTERVAL", 0), settings.get("PRIORITY", 0), 0, programs)


def _setting(expr: s.Expr, span: Span, report: Report) -> int:
    try:
        value = fold(expr)
    except NotConstant as problem:
        report.error("P0027", problem.span, problem.reason)
        return 0
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        report.error("P0025", span, "an interval is a duration and a priority a number, not negative")
        return 0
    return value


# ---------------------------------------------------------------- memory


def assemble(declarations: Declarations, instances: list[tuple[str, Scope]], image: Image,
             plan: Functions, addresses: list[Address]) -> Layout:
    """Return the layout of memory: initial values, tags, extents and clocks."""
    initial = bytearray(plan.end)
    slots: list[Slot] = []
    found: list[ClockCell] = []
    placed = [("", declarations.globals, -(-image.size // 8) * 8),
              *((name, scope, base) for (name, scope), base in
                zip(instances, plan.bases, strict=True))]
    located: set[str] = set()
    for name, scope, base in placed:
        data = default_bytes(scope.type)
        initial[base:base + len(data)] = data
        slots += _located_slots(scope, name, initial, located)
        slots += _variable_slots(scope.type, name, base)
        found += [ClockCell(offset, _is_observed(holder))
                  for offset, holder in clocks(scope.type, base)]
    slots += _direct_slots([scope for _, scope, _ in placed], addresses, image,
                           {slot.tag.address for slot in slots})
    for offset, data in plan.initial:
        initial[offset:offset + len(data)] = data
    return Layout(bytes(initial), tuple(slots), tuple(image.extents), tuple(found))


def _tag(name: str, of: ElementaryType | StringType, address: str = "") -> Tag:
    """Return the tag of a variable; enumerations and subranges show as their base type."""
    shown = of.base.name if isinstance(of, SubrangeType) else \
        "DINT" if isinstance(of, EnumType) else of.name
    return Tag(name, shown, "ns" if of.kind == "time" else "", address)


def _located_slots(scope: Scope, instance: str, initial: bytearray,
                   located: set[str]) -> list[Slot]:
    slots = []
    for each in scope.located:
        if each.initial is not None:
            initial[each.offset:each.offset + each.type.size] = each.initial
        name = f"{instance}.{each.name}" if instance else each.name
        if not each.name.startswith("%") and name.upper() not in located:
            located.add(name.upper())
            slots.append(Slot(_tag(name, each.type, str(each.address)), each.offset))
    return slots


def _variable_slots(block: BlockType, name: str, base: int) -> list[Slot]:
    slots = []
    for leaf, offset, of in _leaves(block, name, base):
        slots.append(Slot(_tag(leaf, of), offset))
    return slots


def _leaves(block: Type, name: str, base: int) -> Iterable[tuple[str, int, ElementaryType | StringType]]:
    for leaf, offset, of in leaves(block, name, base):
        yield leaf.removeprefix("."), offset, of


def _direct_slots(scopes: list[Scope], addresses: list[Address], image: Image,
                  named: set[str]) -> list[Slot]:
    """Return a slot for every address that the program uses and no named variable has."""
    types = {str(each.address): each.type for scope in scopes for each in scope.located}
    unnamed = sorted(set(addresses), key=lambda a: (a.area, a.index))
    return [Slot(_tag(str(a), types.get(str(a), TYPE_OF_SIZE[a.area[1]]), str(a)), image.offset(a))
            for a in unnamed if str(a) not in named]


def _is_observed(holder: BlockType) -> bool:
    return holder.kind == "CLOCK" or holder.name.endswith("observed")
