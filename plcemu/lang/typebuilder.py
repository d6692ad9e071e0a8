"""Types and initial values from what is written: specifications to types, values to bytes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from plcemu.base.spans import Span
from plcemu.base.types import ElementaryType, StringType, Value
from plcemu.lang import syntax as s
from plcemu.lang.constants import Lookup, NotConstant, constant_value, fold
from plcemu.lang.report import Report
from plcemu.lang.types import (
    DINT,
    LINT,
    ArrayType,
    BlockType,
    EnumType,
    PresetString,
    SubrangeType,
    Type,
    default_bytes,
    enum_type,
    subrange_type,
)

STRING_LENGTH = 254
"""Characters of a STRING that is declared without a length."""

ELEMENT_LIMIT = 1_000_000
"""Elements that an array may have."""

FindType = Callable[[str, Span], Type | None]


class TypeBuilder:
    """Makes types and initial bytes.

    Args:
        find: gives the type of a name; reports unknown ones.
        lookup: gives the value of a named constant.
        members: takes the names of every enumeration it makes.
        report: takes the mistakes.
    """

    def __init__(self, find: FindType, lookup: Lookup, members: dict[str, tuple[EnumType, int]],
                 report: Report) -> None:
        self._find, self._lookup, self._members, self._report = find, lookup, members, report

    # ------------------------------------------------------------ types

    def type(self, spec: s.TypeSpec, name: str = "") -> Type | None:
        """Return the type that a specification describes, or None after a reported mistake."""
        if isinstance(spec, s.NamedType):
            return self._find(spec.name, spec.span)
        if isinstance(spec, s.StringSpec):
            return self._string(spec)
        if isinstance(spec, s.SubrangeSpec):
            return self._subrange(spec, name)
        if isinstance(spec, s.EnumSpec):
            return self._enumeration(spec, name)
        if isinstance(spec, s.ArraySpec):
            return self._array(spec, name)
        return self._struct(spec, name)

    def _integer(self, expr: s.Expr) -> int | None:
        try:
            value = fold(expr, self._lookup)
        except NotConstant as problem:
            self._report.error("P0027", problem.span, problem.reason)
            return None
        is_whole = isinstance(value, int) and not isinstance(value, bool)
        if not isinstance(value, int) or not is_whole or not LINT.low <= value <= LINT.high:
            self._report.error("P0023", expr.span, "a whole number is expected here")
            return None
        return value

    def _string(self, spec: s.StringSpec) -> Type | None:
        length = STRING_LENGTH if spec.length is None else self._integer(spec.length)
        if length is None:
            return None
        if not 1 <= length <= 65535:
            self._report.error("P0025", spec.span, "a string holds 1 to 65535 characters")
            return None
        return StringType(length, spec.wide)

    def _subrange(self, spec: s.SubrangeSpec, name: str) -> Type | None:
        base = self._find(spec.base, spec.span)
        low, high = self._integer(spec.low), self._integer(spec.high)
        if base is None or low is None or high is None:
            return None
        if not isinstance(base, ElementaryType) or base.kind not in ("int", "uint"):
            self._report.error("P0023", spec.span, f"{base.name} has no subranges")
            return None
        if not base.low <= low <= high <= base.high:
            self._report.error("P0025", spec.span, f"{low}..{high} is no range of {base.name}")
            return None
        return subrange_type(name or f"{base.name} ({low}..{high})", base, low, high)

    def _enumeration(self, spec: s.EnumSpec, name: str) -> Type | None:
        members: list[tuple[str, int]] = []
        following = 0
        for member, expr, span in spec.members:
            value = following if expr is None else self._integer(expr)
            if value is None:
                return None
            if member.upper() in (m.upper() for m, _ in members):
                self._report.error("P0021", span, f"{member!r} stands twice")
            members.append((member, value))
            following = value + 1
            if not DINT.low <= value <= DINT.high:
                self._report.error("P0025", span, "the value of an enumeration is a DINT")
                return None
        of = enum_type(name or "enumeration", tuple(members))
        for member, value in members:
            self._members.setdefault(member.upper(), (of, value))
        return of

    def _array(self, spec: s.ArraySpec, name: str) -> Type | None:
        element = self.type(spec.element)
        ranges: list[tuple[int, int]] = []
        count = 1
        for low_expr, high_expr in spec.ranges:
            low, high = self._integer(low_expr), self._integer(high_expr)
            if low is None or high is None:
                return None
            if high < low:
                self._report.error("P0025", low_expr.span, f"{low}..{high} is no range")
                return None
            ranges.append((low, high))
            count *= high - low + 1
        if element is None:
            return None
        if count > ELEMENT_LIMIT:
            self._report.error("P0100", spec.span, f"an array has at most {ELEMENT_LIMIT} elements")
            return None
        limits = ", ".join(f"{low}..{high}" for low, high in ranges)
        return ArrayType(name or f"ARRAY [{limits}] OF {element.name}", element, tuple(ranges))

    def _struct(self, spec: s.StructSpec, name: str) -> Type | None:
        made = BlockType(name or "STRUCT", "STRUCT")
        for field in spec.fields:
            of = self.type(field.type)
            if of is None:
                return None
            if field.name.upper() in made.fields:
                self._report.error("P0021", field.span, f"{field.name!r} is declared twice")
                continue
            initial = self.initial(field.initial, of) if field.initial is not None else None
            made.add(field.name, of, section="FIELD", initial=initial)
        made.size = -(-made.size // 8) * 8
        return made

    def alias(self, declaration: s.TypeDeclaration) -> Type | None:
        """Return the type that a TYPE declaration names, with its own initial value."""
        of = self.type(declaration.spec, declaration.name)
        if of is None or declaration.initial is None:
            return of
        data = self.initial(declaration.initial, of)
        if data is None:
            return of
        if isinstance(of, ArrayType):
            return replace(of, name=declaration.name, initial=data)
        if isinstance(of, EnumType):
            return self._with_first(of, of.unpack(data))
        if isinstance(of, BlockType):
            copy = BlockType(declaration.name, of.kind, {}, of.size)
            copy.fields = {k: replace(f, initial=data[f.offset:f.offset + f.type.size])
                           for k, f in of.fields.items()}
            return copy
        if isinstance(of, StringType):
            return PresetString(of.capacity, of.wide, data)
        base = of.base if isinstance(of, SubrangeType) else of
        return replace(subrange_type(declaration.name, base, of.low, of.high),
                       default=of.unpack(data))

    def _with_first(self, of: EnumType, first: Value) -> EnumType:
        """Return an enumeration with another default; its names are of that type from now on."""
        made = replace(of, members=tuple(sorted(of.members, key=lambda m: m[1] != first)))
        for key, (owner, value) in list(self._members.items()):
            if owner == of:
                self._members[key] = (made, value)
        return made

    # ------------------------------------------------------------ initial values

    def initial(self, value: s.InitialValue, of: Type) -> bytes | None:
        """Return the bytes of an initial value; None after a reported mistake."""
        if isinstance(of, ArrayType):
            return self._array_value(value, of)
        if isinstance(of, BlockType):
            return self._block_value(value, of)
        if isinstance(value, s.ListValue | s.FieldValues):
            self._report.error("P0023", value.span, f"{of.name} takes a single value")
            return None
        found = constant_value(value, of, self._report, self._lookup)
        return None if found is None else of.pack(found)

    def _array_value(self, value: s.InitialValue, of: ArrayType) -> bytes | None:
        if not isinstance(value, s.ListValue):
            self._report.error("P0023", value.span, "the values of an array stand in [ ]")
            return None
        data = bytearray(default_bytes(of))
        place = 0
        for count_expr, item in value.items:
            count = 1 if count_expr is None else self._integer(count_expr)
            element = None if item is None else self.initial(item, of.element)
            if count is None or (item is not None and element is None):
                return None
            if place + count > of.count:
                self._report.error("P0025", value.span, f"{of.name} has {of.count} elements, more "
                                   "values are given")
                return None
            if element is not None:
                for n in range(place, place + count):
                    data[n * of.stride:n * of.stride + len(element)] = element
            place += count
        return bytes(data)

    def _block_value(self, value: s.InitialValue, of: BlockType) -> bytes | None:
        if not isinstance(value, s.FieldValues):
            self._report.error("P0023", value.span, f"the values of {of.name} stand in ( ), each "
                               "with its field's name")
            return None
        data = bytearray(default_bytes(of))
        for name, item, span in value.items:
            field = of.visible(name)
            if field is None:
                self._report.error("P0020", span, f"{of.name} has no {name!r}")
                return None
            part = self.initial(item, field.type)
            if part is None:
                return None
            data[field.offset:field.offset + len(part)] = part
        return bytes(data)
