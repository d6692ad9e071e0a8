"""Types and places: what a name in a POU stands for.

Elementary types come from `plcemu.base.types`. A block type is a layout of fields: of a function
block, a program, a step or a clock cell.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from plcemu.base.types import ELEMENTARY, ElementaryType, Value

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


@dataclass(slots=True)
class Field:
    """A field of a block type, `offset` bytes after the instance's begin."""

    name: str
    type: Type
    offset: int
    section: str = "VAR"
    initial: Value | None = None
    constant: bool = False


@dataclass(slots=True)
class BlockType:
    """A type with fields.

    Attributes:
        name: in the user's spelling.
        kind: `PROGRAM`, `FUNCTION_BLOCK`, `STEP` or `CLOCK`.
        fields: by name in capitals, in order of declaration.
        size: bytes of an instance.
    """

    name: str
    kind: str
    fields: dict[str, Field] = field(default_factory=dict)
    size: int = 0

    def add(self, name: str, of: Type, **details: object) -> Field:
        """Append a field, aligned to its size, and return it."""
        unit = of.size if isinstance(of, ElementaryType) else 8
        offset = -(-self.size // unit) * unit
        made = Field(name, of, offset, **details)  # type: ignore[arg-type]
        self.fields[name.upper()] = made
        self.size = offset + of.size
        return made

    def visible(self, name: str) -> Field | None:
        """Return the field of that name that others may name: of a function block no local one."""
        found = self.fields.get(name.upper())
        hidden = found is not None and self.kind == "FUNCTION_BLOCK" and found.section == "VAR"
        return None if hidden else found

    def walk(self, prefix: str = "", base: int = 0) -> Iterator[tuple[str, int, Field]]:
        """Yield (dotted name, offset, field) of every elementary field, nested ones included."""
        for each in self.fields.values():
            name, offset = f"{prefix}{each.name}", base + each.offset
            if isinstance(each.type, BlockType):
                yield from each.type.walk(name + ".", offset)
            else:
                yield name, offset, each

    def clocks(self, base: int = 0) -> Iterator[tuple[int, BlockType]]:
        """Yield (offset, holder) of every clock cell in an instance that begins at `base`."""
        if self.kind in ("CLOCK", "STEP"):
            yield base + self.fields["ELAPSED" if self.kind == "CLOCK" else "T"].offset, self
        for each in self.fields.values():
            if isinstance(each.type, BlockType):
                yield from each.type.clocks(base + each.offset)


Type = ElementaryType | BlockType


def _cell(name: str, kind: str, elapsed: str, limit: str) -> BlockType:
    made = BlockType(name, kind)
    made.add(elapsed, TIME)
    made.add(limit, TIME)
    return made


CLOCK = _cell("__CLOCK", "CLOCK", "elapsed", "limit")
"""The clock cell (see `plcemu.ir.program.ClockCell`) as a type for the library's timers."""


def step_type(observed: bool) -> BlockType:
    """Return the type of a step: flag X and elapsed time T; `observed` if the program reads T."""
    made = BlockType("STEP observed" if observed else "STEP", "STEP")
    made.add("T", TIME)
    made.add("__limit", TIME)
    made.add("X", BOOL)
    return made


@dataclass(frozen=True, slots=True)
class Place:
    """Where a value stands.

    Attributes:
        base: `this`, `memory` or `local`.
        offset: in bytes; of a local its number.
        type: what stands there.
        name: in the user's spelling.
        read_only: why it cannot be written, or empty.
    """

    base: str
    offset: int
    type: Type
    name: str = ""
    read_only: str = ""


def widens(source: ElementaryType, target: ElementaryType) -> bool:
    """Whether a value of one type becomes one of the other without loss."""
    return source == target or target.name in _WIDENS.get(source.name, ())


def common_type(a: ElementaryType, b: ElementaryType) -> ElementaryType | None:
    """Return the type both operands take, or None; a literal takes the other's type."""
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
