"""The layout of memory: initial values, tags, extents, clock cells and retained variables."""

from __future__ import annotations

from collections.abc import Iterable

from plcemu.base.areas import Address
from plcemu.base.tags import Tag
from plcemu.base.types import ElementaryType, StringType
from plcemu.ir.program import ClockCell, Expiry, Layout, Slot
from plcemu.ir.shape import Record, Variable
from plcemu.lang.frames import Functions
from plcemu.lang.image import Image
from plcemu.lang.located import leaf_address
from plcemu.lang.planning import Planned
from plcemu.lang.scope import Scope
from plcemu.lang.scopes import Declarations
from plcemu.lang.shapes import Shapes
from plcemu.lang.types import (
    CLOCK,
    TYPE_OF_SIZE,
    BlockType,
    Clock,
    EnumType,
    SubrangeType,
    Type,
    clocks,
    default_bytes,
    leaves,
    retained_fields,
)


def assemble(declarations: Declarations, instances: list[Planned], image: Image,
             plan: Functions, addresses: list[Address], is_et_read: bool) -> Layout:
    """Return the layout of memory: initial values, tags, extents and clocks.

    `is_et_read` is whether any text reads the elapsed time of a timer.
    """
    initial = bytearray(plan.end)
    slots: list[Slot] = []
    found: list[ClockCell] = []
    placed = [("", declarations.globals, -(-image.size // 8) * 8),
              *((each.name, each.scope, base) for each, base in
                zip(instances, plan.bases, strict=True))]
    whole = {each.name for each in instances if each.declaration and each.declaration.retain}
    located: set[str] = set()
    retained: list[Variable] = []
    variables: list[Variable] = []
    carried, kept = Shapes(), Shapes(retained=True)
    for name, scope, base in placed:
        data = default_bytes(scope.type)
        initial[base:base + len(data)] = data
        slots += _located_slots(scope, name, initial, located)
        variables += _variables(scope, name, base, carried)
        retained += _retained(scope, name, base, kept, name in whole)
        slots += _variable_slots(scope.type, name, base)
        found += [_cell(clock, is_et_read) for clock in clocks(scope.type, base)]
    slots += _direct_slots([scope for _, scope, _ in placed], addresses, image,
                           {slot.tag.address for slot in slots})
    for offset, data in plan.initial:
        initial[offset:offset + len(data)] = data
    return Layout(bytes(initial), tuple(slots), tuple(image.extents), tuple(found),
                  tuple(retained), tuple(variables))


def _tag(name: str, of: ElementaryType | StringType, address: str = "") -> Tag:
    """Return the tag of a variable; enumerations and subranges show as their base type."""
    shown = of.base.name if isinstance(of, SubrangeType) else \
        "DINT" if isinstance(of, EnumType) else of.name
    values = of.members if isinstance(of, EnumType) else ()
    return Tag(name, shown, "ns" if of.kind == "time" else "", address, values=values)


def _located_slots(scope: Scope, instance: str, initial: bytearray,
                   located: set[str]) -> list[Slot]:
    slots = []
    for each in scope.located:
        if each.initial is not None:
            initial[each.offset:each.offset + len(each.initial)] = each.initial
        name = f"{instance}.{each.name}" if instance else each.name
        if not each.name.startswith("%") and name.upper() not in located:
            located.add(name.upper())
            slots += [Slot(_tag(leaf, of, leaf_address(each.address, at - each.offset, of)), at)
                      for leaf, at, of in leaves(each.type, name, each.offset)]
    return slots


def _variables(scope: Scope, instance: str, base: int, shapes: Shapes) -> list[Variable]:
    """Return the variables of an instance that an edited program can take over.

    Inputs are left out: their values are the world's.
    """
    prefix = f"{instance}." if instance else ""
    found = [Variable(prefix + each.name, each.type.name, shapes.of(each.type), each.offset)
             for each in scope.located if each.address.area[0] != "I" and not each.constant]
    record = shapes.of(scope.type)
    assert isinstance(record, Record)
    return found + [Variable(prefix + name, scope.type.fields[name.upper()].type.name, shape,
                             base + offset) for name, offset, shape in record.fields]


def _retained(scope: Scope, instance: str, base: int, shapes: Shapes,
              is_whole: bool) -> list[Variable]:
    """Return the RETAIN variables of an instance, those inside its function blocks too.

    Of an instance that is RETAIN as a whole these are all that are not NON_RETAIN.
    """
    if is_whole:
        left_out = {each.name for each in scope.located if each.retain is False}
        return [v for v in _variables(scope, instance, base, shapes)
                if v.name.removeprefix(f"{instance}.") not in left_out]
    prefix = f"{instance}." if instance else ""
    found = [Variable(prefix + each.name, each.type.name, shapes.of(each.type), each.offset)
             for each in scope.located if each.retain and not each.constant]
    found += [Variable(name.removeprefix("."), each.type.name, shapes.of(each.type), offset)
              for name, offset, each in retained_fields(scope.type, instance, base)]
    return found


def _variable_slots(block: BlockType, name: str, base: int) -> list[Slot]:
    slots = []
    for leaf, offset, of in _leaves(block, name, base):
        slots.append(Slot(_tag(leaf, of), offset))
    return slots


def _leaves(block: Type, name: str,
            base: int) -> Iterable[tuple[str, int, ElementaryType | StringType]]:
    for leaf, offset, of in leaves(block, name, base):
        yield leaf.removeprefix("."), offset, of


def _direct_slots(scopes: list[Scope], addresses: list[Address], image: Image,
                  named: set[str]) -> list[Slot]:
    """Return a slot for every address that the program uses and no named variable has."""
    types = {str(each.address): each.type for scope in scopes for each in scope.located
             if isinstance(each.type, ElementaryType)}
    unnamed = sorted(set(addresses), key=lambda a: (a.area, a.index))
    return [Slot(_tag(str(a), types.get(str(a), TYPE_OF_SIZE[a.area[1]]), str(a)), image.offset(a))
            for a in unnamed if str(a) not in named]


def _cell(clock: Clock, is_et_read: bool) -> ClockCell:
    if clock.holder is not CLOCK:
        return ClockCell(clock.offset, clock.holder.name.endswith("observed"))
    if clock.copy is None or is_et_read:
        return ClockCell(clock.offset, True)
    return ClockCell(clock.offset, True,
                     Expiry(clock.copy, clock.offset + CLOCK.fields["VARIED"].offset))
