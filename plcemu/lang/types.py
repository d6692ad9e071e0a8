"""Types and places: what a name in a POU stands for.

Elementary types come from `plcemu.base.types`; enumerations and subranges are elementary types with
values or limits of their own. A block type is a layout of fields: of a structure, a function block,
a program, a function's frame, a step or a clock cell.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

from plcemu.base.types import ELEMENTARY, ElementaryType, StringType, Value

if TYPE_CHECKING:
    from plcemu.lang.syntax import Expr

INT_LITERAL = ElementaryType("integer literal", "literal", 0, 0, "", "")
REAL_LITERAL = ElementaryType("real literal", "literal", 0, 0, "", "")
BOOL, TIME = ELEMENTARY["BOOL"], ELEMENTARY["TIME"]
INT, DINT, LINT, REAL, LREAL = (ELEMENTARY[n] for n in ("INT", "DINT", "LINT", "REAL", "LREAL"))

TYPE_OF_SIZE = {"X": BOOL, "B": ELEMENTARY["BYTE"], "W": ELEMENTARY["WORD"],
                "D": ELEMENTARY["DWORD"], "L": ELEMENTARY["LWORD"]}
"""The type of a direct address, by its size letter, that no declaration gives one (table 15)."""

_WIDENS: dict[str, tuple[str, ...]] = {
    "SINT": ("INT", "DINT", "LINT", "REAL", "LREAL"),
    "INT": ("DINT", "LINT", "REAL", "LREAL"),
    "DINT": ("LINT", "LREAL"),
    "LINT": (),
    "USINT": ("UINT", "UDINT", "ULINT", "INT", "DINT", "LINT", "REAL", "LREAL"),
    "UINT": ("UDINT", "ULINT", "DINT", "LINT", "REAL", "LREAL"),
    "UDINT": ("ULINT", "LINT", "LREAL"),
    "BYTE": ("WORD", "DWORD", "LWORD"),
    "WORD": ("DWORD", "LWORD"),
    "DWORD": ("LWORD",),
    "REAL": ("LREAL",),
    "TIME": ("LTIME",),
    "LTIME": ("TIME",),
}
"""Implicit conversions that lose nothing (3rd edition, figure 11), each in order of preference."""


@dataclass(frozen=True, slots=True)
class EnumType(ElementaryType):
    """An enumeration: a DINT in memory with names for its values, the first of them the default."""

    members: tuple[tuple[str, int], ...] = ()

    @property
    def low(self) -> int:
        """The smallest value that has a name."""
        return min(value for _, value in self.members)

    @property
    def high(self) -> int:
        """The largest value that has a name."""
        return max(value for _, value in self.members)


def enum_type(name: str, members: tuple[tuple[str, int], ...]) -> EnumType:
    """Return an enumeration."""
    return EnumType(name, "enum", 4, 32, "i", "i32", members)


@dataclass(frozen=True, slots=True)
class SubrangeType(ElementaryType):
    """A type with narrower limits, or just a default of its own; in memory it is its base type."""

    base: ElementaryType = INT
    first: int = 0
    last: int = 0
    default: Value | None = None

    @property
    def low(self) -> int:
        """The lower limit."""
        return self.first

    @property
    def high(self) -> int:
        """The upper limit."""
        return self.last

    @property
    def first_value(self) -> Value:
        """What a variable holds at first: the declared default, 0, or the lower limit."""
        if self.default is not None:
            return self.default
        return 0 if self.first <= 0 <= self.last else self.first


def subrange_type(name: str, base: ElementaryType, first: int, last: int) -> SubrangeType:
    """Return a subrange of an integer type, or another type with its own limits."""
    return SubrangeType(name, base.kind, base.size, base.bits, base.code, base.machine, base,
                        first, last)


@dataclass(frozen=True, slots=True)
class PresetString(StringType):
    """A string type with an initial value of its own."""

    initial: bytes = b""


@dataclass(frozen=True, slots=True, eq=False)
class ArrayType:
    """An array: its element type and the (lowest, highest) subscript of every dimension."""

    name: str
    element: Type
    ranges: tuple[tuple[int, int], ...]
    initial: bytes | None = None

    kind = "array"
    machine = "u32"

    @property
    def count(self) -> int:
        """How many elements it has."""
        product = 1
        for low, high in self.ranges:
            product *= high - low + 1
        return product

    @property
    def stride(self) -> int:
        """Bytes from one element to the next."""
        unit = alignment(self.element)
        return -(-self.element.size // unit) * unit

    @property
    def size(self) -> int:
        """Bytes of the whole."""
        return self.count * self.stride


@dataclass(slots=True)
class Field:
    """A field of a block type, `offset` bytes after the instance's begin.

    A VAR_IN_OUT holds the address of its variable, whose type is `target`. `retain` is False for
    NON_RETAIN, None where nothing is written.
    """

    name: str
    type: Type
    offset: int
    section: str = "VAR"
    initial: bytes | None = None
    constant: bool = False
    retain: bool | None = None
    target: Type | None = None

    @property
    def bytes(self) -> bytes:
        """What the field holds at first."""
        return self.initial if self.initial is not None else default_bytes(self.type)


@dataclass(slots=True, eq=False)
class BlockType:
    """A type with fields.

    Attributes:
        name: in the user's spelling.
        kind: `PROGRAM`, `FUNCTION_BLOCK`, `FUNCTION`, `STRUCT`, `STEP`, `CLOCK` or `GLOBAL`.
        fields: by name in capitals, in order of declaration.
        size: bytes of an instance.
    """

    name: str
    kind: str
    fields: dict[str, Field] = field(default_factory=dict)
    size: int = 0

    @property
    def machine(self) -> str:
        """The machine type of its address, by which it is handed on."""
        return "u32"

    def add(self, name: str, of: Type, **details: object) -> Field:
        """Append a field, aligned, and return it."""
        unit = alignment(of)
        offset = -(-self.size // unit) * unit
        made = Field(name, of, offset, **details)  # type: ignore[arg-type]
        self.fields[name.upper()] = made
        self.size = offset + of.size
        return made

    def visible(self, name: str) -> Field | None:
        """Return the field of that name that others may name: of a function block no local one."""
        found = self.fields.get(name.upper())
        hidden = found is not None and self.kind == "FUNCTION_BLOCK" \
            and found.section in ("VAR", "VAR_IN_OUT", "VAR_TEMP")
        return None if hidden else found


Type = ElementaryType | StringType | ArrayType | BlockType


def alignment(of: Type) -> int:
    """Return the number of bytes that a value's place is a multiple of."""
    if isinstance(of, ElementaryType):
        return of.size
    if isinstance(of, StringType):
        return 2
    return alignment(of.element) if isinstance(of, ArrayType) else 8


def default_bytes(of: Type) -> bytes:
    """Return what a variable of a type holds when no initial value is written."""
    if isinstance(of, EnumType):
        return of.pack(of.members[0][1])
    if isinstance(of, SubrangeType):
        return of.pack(of.first_value)
    if isinstance(of, PresetString):
        return of.initial
    if isinstance(of, ArrayType):
        return of.initial if of.initial is not None \
            else default_bytes(of.element).ljust(of.stride, b"\0") * of.count
    if not isinstance(of, BlockType):
        return bytes(of.size)
    block = bytearray(of.size)
    for each in of.fields.values():
        block[each.offset:each.offset + each.type.size] = each.bytes
    return bytes(block)


ELEMENT_TAGS = 1024
"""Arrays with more elements, those of arrays in them counted in, have no tags for them."""


def leaves(of: Type, name: str, offset: int,
           outer: int = 1) -> Iterator[tuple[str, int, ElementaryType | StringType]]:
    """Yield (dotted name, offset, type) of every single value in a variable, hidden ones left out.

    Arrays with more than `ELEMENT_TAGS` elements are left out, those of `outer` arrays counted in.
    """
    if isinstance(of, ArrayType):
        total = of.count * outer
        if total <= ELEMENT_TAGS:
            for n, subscripts in enumerate(_subscripts(of.ranges)):
                element = f"{name}[{','.join(map(str, subscripts))}]"
                yield from leaves(of.element, element, offset + n * of.stride, total)
    elif isinstance(of, BlockType):
        for each in of.fields.values():
            if not each.name.startswith("__") and each.section not in ("VAR_IN_OUT", "VAR_TEMP"):
                yield from leaves(each.type, f"{name}.{each.name}", offset + each.offset, outer)
    else:
        yield name, offset, of


def _subscripts(ranges: tuple[tuple[int, int], ...]) -> Iterator[tuple[int, ...]]:
    if not ranges:
        yield ()
        return
    low, high = ranges[0]
    for first in range(low, high + 1):
        for rest in _subscripts(ranges[1:]):
            yield (first, *rest)


def retained_fields(of: Type, name: str, offset: int) -> Iterator[tuple[str, int, Field]]:
    """Yield (dotted name, offset, field) of every RETAIN field in a variable, outermost only."""
    if isinstance(of, ArrayType):
        if any(True for _ in retained_fields(of.element, "", 0)):
            for n, subscripts in enumerate(_subscripts(of.ranges)):
                yield from retained_fields(of.element, f"{name}[{','.join(map(str, subscripts))}]",
                                           offset + n * of.stride)
    elif isinstance(of, BlockType):
        for each in of.fields.values():
            if each.retain and not each.constant:
                yield f"{name}.{each.name}", offset + each.offset, each
            elif each.retain is None:
                yield from retained_fields(each.type, f"{name}.{each.name}", offset + each.offset)


def clocks(of: Type, offset: int,
           timer: tuple[BlockType, int] | None = None) -> Iterator[Clock]:
    """Yield every clock cell in a variable; `timer` is the block around it and its offset."""
    if isinstance(of, ArrayType):
        if any(True for _ in clocks(of.element, 0)):
            for n in range(of.count):
                yield from clocks(of.element, offset + n * of.stride)
    elif isinstance(of, BlockType):
        if of.kind == "STEP":
            yield Clock(offset + of.fields["T"].offset, of)
        elif of is CLOCK:
            copy = timer[1] + timer[0].fields["ET"].offset \
                if timer is not None and timer[0].name.upper().startswith(TIMERS) else None
            yield Clock(offset, of, copy)
        for each in of.fields.values():
            yield from clocks(each.type, offset + each.offset, (of, offset))


class Clock(NamedTuple):
    """A clock cell: where it stands, the type that holds it, and where a timer copies it (ET)."""

    offset: int
    holder: BlockType
    copy: int | None = None


TIMERS = ("TON", "TOF", "TP")
"""The blocks that compare the elapsed time of their cell with its limit and otherwise only copy it
to ET (library/timers.st)."""


def _cell(name: str, kind: str, elapsed: str, limit: str) -> BlockType:
    made = BlockType(name, kind)
    made.add(elapsed, TIME)
    made.add(limit, TIME)
    return made


CLOCK = _cell("__CLOCK", "CLOCK", "elapsed", "limit")
"""The clock cell (see `plcemu.ir.program.ClockCell`) as a type for the library's timers."""

CLOCK.add("varied", BOOL)


def step_type(observed: bool) -> BlockType:
    """Return the type of a step: flag X and elapsed time T; `observed` if the program reads T."""
    made = BlockType("STEP observed" if observed else "STEP", "STEP")
    made.add("T", TIME)
    made.add("__limit", TIME)
    made.add("X", BOOL)
    return made


@dataclass(frozen=True, slots=True)
class Subscript:
    """A subscript that is not known before the program runs."""

    value: Expr
    low: int
    count: int
    size: int


@dataclass(frozen=True, slots=True)
class Place:
    """Where a value stands.

    Attributes:
        base: `this`, `memory`, `local`, or `pointer` for what a cell of the instance points at.
        offset: in bytes; of a local its number.
        type: what stands there.
        name: in the user's spelling.
        read_only: why it cannot be written, or empty.
        path: subscripts whose distances come on top.
        cell: of a pointer, where in the instance it stands.
        holder: of a bit, the type of the variable it is a bit of; else None.
        bit: its number.
    """

    base: str
    offset: int
    type: Type
    name: str = ""
    read_only: str = ""
    path: tuple[Subscript, ...] = ()
    cell: int = 0
    holder: ElementaryType | None = None
    bit: int = 0


def root(of: Type) -> Type:
    """Return the type that a subrange narrows; other types themselves."""
    return of.base if isinstance(of, SubrangeType) else of


def widens(source: Type, target: Type) -> bool:
    """Whether a value of one type becomes one of the other without loss."""
    source, target = root(source), root(target)
    if isinstance(source, StringType) and isinstance(target, StringType):
        return source.wide == target.wide
    if isinstance(source, ArrayType) and isinstance(target, ArrayType):
        return source.ranges == target.ranges and source.element == target.element
    if not isinstance(source, ElementaryType) or not isinstance(target, ElementaryType):
        return source is target
    return source == target or target.name in _WIDENS.get(source.name, ())


def common_type(a: Type, b: Type) -> Type | None:
    """Return the type both operands take, or None; a literal takes the other's type."""
    a, b = root(a), root(b)
    if a == b:
        return a
    for literal, other in ((a, b), (b, a)):
        if literal is INT_LITERAL and other.kind in ("int", "uint", "bits", "float", "literal"):
            return other
        if literal is REAL_LITERAL and other.kind in ("float", "literal"):
            return other if other.kind == "float" else REAL_LITERAL
    if widens(a, b):
        return b
    if widens(b, a):
        return a
    return next((ELEMENTARY[n] for n in _WIDENS.get(a.name, ()) if n in _WIDENS.get(b.name, ())),
                None)


Members = Mapping[str, tuple[EnumType, int]]
"""The names of enumerations, in capitals, with their type and value."""
