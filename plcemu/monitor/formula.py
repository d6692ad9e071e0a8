"""Formulas of the property language: their tree, their operators, and their text.

The table `OPERATORS` says all that is to know of an operator: its spelling, how tightly it binds,
to which side it groups, and what kind it is. The parser and the printer both derive from it, so
that a printed formula reads back as the same tree. Whoever judges or proves formulas works on this
tree; patterns (`plcemu.monitor.patterns`) are expanded to it while they are read.
"""

from __future__ import annotations

import enum
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

from plcemu.base.spans import Source, Span
from plcemu.base.time import format_duration

NOWHERE = Span(Source("<formula>", ""), 0, 0)
"""The place of a formula that was built, not read."""


class Kind(enum.Enum):
    """What an operator takes and gives."""

    LOGIC = "truth values to a truth value"
    COMPARISON = "values to a truth value"
    ARITHMETIC = "numbers to a number"
    FUTURE = "what is still to come on this run"
    PAST = "what has been on this run"
    BRANCHING = "what comes on other runs, too"
    PULSE = "what changed at this very instant"
    EARLIER = "the value before"


class Group(enum.Enum):
    """To which side operators of one level group without parentheses."""

    LEFT = "left"
    RIGHT = "right"
    NONE = "none"
    PREFIX = "prefix"
    CALL = "call"
    PATH = "brackets after A or E"


@dataclass(frozen=True, slots=True)
class Operator:
    """One row of the table of operators.

    Attributes:
        name: the spelling, which is also the `op` of the tree's nodes.
        level: how tightly it binds; a larger number binds tighter.
        group: to which side it groups, or that it stands before its operand.
        kind: what it takes and gives.
        timed: whether an interval of durations may follow it.
        also: other spellings.
    """

    name: str
    level: int
    group: Group
    kind: Kind
    timed: bool = False
    also: tuple[str, ...] = ()


_ROWS = (
    Operator("-->", 0, Group.NONE, Kind.BRANCHING),
    Operator("<->", 1, Group.LEFT, Kind.LOGIC, also=("↔",)),
    Operator("->", 2, Group.RIGHT, Kind.LOGIC, also=("→", "imply")),
    Operator("xor", 3, Group.LEFT, Kind.LOGIC, also=("XOR",)),
    Operator("|", 3, Group.LEFT, Kind.LOGIC, also=("||", "OR", "or", "∨")),
    Operator("&", 4, Group.LEFT, Kind.LOGIC, also=("&&", "AND", "and", "∧")),
    Operator("U", 5, Group.RIGHT, Kind.FUTURE, timed=True),
    Operator("W", 5, Group.RIGHT, Kind.FUTURE, timed=True),
    Operator("R", 5, Group.RIGHT, Kind.FUTURE, timed=True),
    Operator("S", 5, Group.RIGHT, Kind.PAST, timed=True),
    Operator("!", 6, Group.PREFIX, Kind.LOGIC, also=("NOT", "not", "¬")),
    Operator("G", 6, Group.PREFIX, Kind.FUTURE, timed=True, also=("[]", "□")),
    Operator("F", 6, Group.PREFIX, Kind.FUTURE, timed=True, also=("<>", "◇")),
    Operator("X", 6, Group.PREFIX, Kind.FUTURE),
    Operator("H", 6, Group.PREFIX, Kind.PAST, timed=True),
    Operator("O", 6, Group.PREFIX, Kind.PAST, timed=True),
    Operator("Y", 6, Group.PREFIX, Kind.PAST),
    Operator("AG", 6, Group.PREFIX, Kind.BRANCHING, also=("A[]",)),
    Operator("AF", 6, Group.PREFIX, Kind.BRANCHING, also=("A<>",)),
    Operator("AX", 6, Group.PREFIX, Kind.BRANCHING),
    Operator("EG", 6, Group.PREFIX, Kind.BRANCHING, also=("E[]",)),
    Operator("EF", 6, Group.PREFIX, Kind.BRANCHING, also=("E<>",)),
    Operator("EX", 6, Group.PREFIX, Kind.BRANCHING),
    *(Operator(quantifier + until, 6, Group.PATH, Kind.BRANCHING)
      for quantifier in "AE" for until in "UWR"),
    Operator("=", 7, Group.NONE, Kind.COMPARISON, also=("==",)),
    Operator("!=", 7, Group.NONE, Kind.COMPARISON, also=("<>", "≠")),
    Operator("<", 7, Group.NONE, Kind.COMPARISON),
    Operator("<=", 7, Group.NONE, Kind.COMPARISON, also=("≤",)),
    Operator(">", 7, Group.NONE, Kind.COMPARISON),
    Operator(">=", 7, Group.NONE, Kind.COMPARISON, also=("≥",)),
    Operator("+", 8, Group.LEFT, Kind.ARITHMETIC),
    Operator("-", 8, Group.LEFT, Kind.ARITHMETIC),
    Operator("*", 9, Group.LEFT, Kind.ARITHMETIC),
    Operator("/", 9, Group.LEFT, Kind.ARITHMETIC),
    Operator("MOD", 9, Group.LEFT, Kind.ARITHMETIC, also=("mod",)),
    Operator("negate", 10, Group.PREFIX, Kind.ARITHMETIC, also=("-",)),
    Operator("rise", 11, Group.CALL, Kind.PULSE),
    Operator("fall", 11, Group.CALL, Kind.PULSE),
    Operator("changed", 11, Group.CALL, Kind.PULSE),
    Operator("previous", 11, Group.CALL, Kind.EARLIER),
)
OPERATORS: dict[str, Operator] = {row.name: row for row in _ROWS}

FUNCTIONS: dict[str, tuple[int, int | None]] = {
    "abs": (1, 1), "min": (1, None), "max": (1, None), "ago": (2, 2)}
"""Functions of numbers, and how many operands they take; `ago(x, 5s)` is x 5 s before."""

_WORDLESS = (Group.PREFIX, Group.CALL, Group.PATH)
_SPELLINGS = [(spelling, row) for row in _ROWS for spelling in (row.name, *row.also)]
INFIX: dict[str, Operator] = {s: row for s, row in _SPELLINGS if row.group not in _WORDLESS}
PREFIX: dict[str, Operator] = {s: row for s, row in _SPELLINGS if row.group is Group.PREFIX}
CALLS: dict[str, Operator] = {s: row for s, row in _SPELLINGS if row.group is Group.CALL}
CONSTANTS: dict[str, bool] = {"TRUE": True, "true": True, "FALSE": False, "false": False}
RESERVED: frozenset[str] = frozenset(
    [s for s, row in _SPELLINGS if s.isalpha() and s != "negate" and row.group is not Group.PATH]
    + [*CONSTANTS, *FUNCTIONS, "deadlock"])
"""Words that are printed in back quotes where they name a tag."""

_PLAIN_NAME = re.compile(r"[^\W\d]\w*(?:#\w+|(?:\.\w+|\[-?\d+(?:,-?\d+)*\])*)\Z"
                         r"|%[A-Za-z]+\d+(?:\.\d+)*\Z")


@dataclass(frozen=True, slots=True)
class Interval:
    """A stretch of time relative to an instant, with closed or open ends.

    Attributes:
        low_ns: the lower end, in ns, at least 0.
        high_ns: the upper end, in ns; None is without end.
        low_closed: whether the lower end belongs to it.
        high_closed: whether the upper end belongs to it.
    """

    low_ns: int = 0
    high_ns: int | None = None
    low_closed: bool = True
    high_closed: bool = False

    @property
    def first_ns(self) -> int:
        """The first whole ns inside."""
        return self.low_ns + (not self.low_closed)

    @property
    def last_ns(self) -> int | None:
        """The last whole ns inside; None is without end."""
        return None if self.high_ns is None else self.high_ns - (not self.high_closed)

    @property
    def empty(self) -> bool:
        """Whether no instant lies inside."""
        return self.last_ns is not None and self.last_ns < self.first_ns

    def __str__(self) -> str:
        high = "inf" if self.high_ns is None else format_duration(self.high_ns)
        return (f"{'[' if self.low_closed else '('}{format_duration(self.low_ns)},{high}"
                f"{']' if self.high_closed else ')'}")


@dataclass(frozen=True, slots=True)
class TagRef:
    """A tag by its full name, a unique ending of it, or its address; or a value of an enumeration.

    `GREEN` and `COLOR#GREEN` are values where they are compared with a tag of such a type.
    """

    name: str
    span: Span = field(default=NOWHERE, compare=False)

    def __str__(self) -> str:
        return text(self)


@dataclass(frozen=True, slots=True)
class Literal:
    """A truth value, a number or a character string."""

    value: bool | int | float | str
    span: Span = field(default=NOWHERE, compare=False)

    def __str__(self) -> str:
        return text(self)


@dataclass(frozen=True, slots=True)
class Duration:
    """A duration, as a number of ns."""

    ns: int
    span: Span = field(default=NOWHERE, compare=False)

    def __str__(self) -> str:
        return text(self)


@dataclass(frozen=True, slots=True)
class Unary:
    """An operator with one operand; `op` is a key of `OPERATORS`."""

    op: str
    arg: Formula
    interval: Interval | None = None
    span: Span = field(default=NOWHERE, compare=False)

    def __str__(self) -> str:
        return text(self)


@dataclass(frozen=True, slots=True)
class Binary:
    """An operator with two operands; `op` is a key of `OPERATORS`."""

    op: str
    left: Formula
    right: Formula
    interval: Interval | None = None
    span: Span = field(default=NOWHERE, compare=False)

    def __str__(self) -> str:
        return text(self)


@dataclass(frozen=True, slots=True)
class Call:
    """A function of numbers; `name` is a key of `FUNCTIONS`."""

    name: str
    args: tuple[Formula, ...]
    span: Span = field(default=NOWHERE, compare=False)

    def __str__(self) -> str:
        return text(self)


@dataclass(frozen=True, slots=True)
class Element:
    """An element of an array at computed indices: `level[n + 1]`, `tank[i].full`.

    Attributes:
        array: the array's name.
        indices: one for each dimension.
        rest: what follows the bracket, such as `.full`; may be empty.
    """

    array: str
    indices: tuple[Formula, ...]
    rest: str = ""
    span: Span = field(default=NOWHERE, compare=False)

    def __str__(self) -> str:
        return text(self)


@dataclass(frozen=True, slots=True)
class Deadlock:
    """`deadlock`: no step can follow; a word of checkers."""

    span: Span = field(default=NOWHERE, compare=False)

    def __str__(self) -> str:
        return "deadlock"


Formula = TagRef | Literal | Duration | Unary | Binary | Call | Element | Deadlock

TRUE, FALSE = Literal(True), Literal(False)


def children(formula: Formula) -> tuple[Formula, ...]:
    """Return the operands, left to right."""
    if isinstance(formula, Unary):
        return (formula.arg,)
    if isinstance(formula, Binary):
        return (formula.left, formula.right)
    if isinstance(formula, Call):
        return formula.args
    return formula.indices if isinstance(formula, Element) else ()


def rebuilt(formula: Formula, parts: Sequence[Formula]) -> Formula:
    """Return the formula with other operands; the reverse of `children`."""
    if isinstance(formula, Unary):
        return replace(formula, arg=parts[0])
    if isinstance(formula, Binary):
        return replace(formula, left=parts[0], right=parts[1])
    if isinstance(formula, Call):
        return replace(formula, args=tuple(parts))
    return replace(formula, indices=tuple(parts)) if isinstance(formula, Element) else formula


def walk(formula: Formula) -> Iterator[Formula]:
    """Yield the formula and every part of it, the whole before its parts."""
    yield formula
    for child in children(formula):
        yield from walk(child)


def tag_refs(formula: Formula) -> list[TagRef]:
    """Return the tags of a formula in textual order, each name once."""
    found = {part.name.casefold(): part for part in reversed(list(walk(formula)))
             if isinstance(part, TagRef)}
    return list(reversed(found.values()))


def is_state(formula: Formula) -> bool:
    """Tell whether the formula speaks of one instant only (pulses at that instant included)."""
    timed = (Kind.FUTURE, Kind.PAST, Kind.BRANCHING)
    return not any(isinstance(part, Deadlock) or (isinstance(part, (Unary, Binary))
                                                  and OPERATORS[part.op].kind in timed)
                   for part in walk(formula))


def text(formula: Formula) -> str:
    """Return the formula as text with no needless parentheses."""
    if isinstance(formula, (Unary, Binary)):
        return _operation(formula)
    if isinstance(formula, TagRef):
        plain = _PLAIN_NAME.match(formula.name) and formula.name not in RESERVED
        return formula.name if plain else f"`{formula.name}`"
    if isinstance(formula, Duration):
        return format_duration(formula.ns)
    if isinstance(formula, (Call, Element)):
        return _listed(formula)
    if isinstance(formula, Deadlock):
        return str(formula)
    if isinstance(formula.value, bool):
        return str(formula.value).upper()
    if isinstance(formula.value, str):
        return "'" + formula.value.replace("$", "$$").replace("'", "$'") + "'"
    return repr(formula.value)


def _listed(formula: Call | Element) -> str:
    parts = ", ".join(text(part) for part in children(formula))
    if isinstance(formula, Call):
        return f"{formula.name}({parts})"
    return f"{text(TagRef(formula.array))}[{parts}]{formula.rest}"


def _operation(formula: Unary | Binary) -> str:
    row = OPERATORS[formula.op]
    if row.group is Group.PATH and isinstance(formula, Binary):
        path = replace(formula, op=row.name[1])
        return f"{row.name[0]}[{text(path)}]"
    name = ("-" if row.name == "negate" else row.name) + str(formula.interval or "")
    if isinstance(formula, Binary):
        left = _operand(formula.left, row.level + (row.group is not Group.LEFT))
        right = _operand(formula.right, row.level + (row.group is not Group.RIGHT))
        return f"{left} {name} {right}"
    if row.group is Group.CALL:
        return f"{name}({text(formula.arg)})"
    operand = _operand(formula.arg, row.level)
    return name + ("" if name == "!" or (name == "-" and operand[0] != "-") else " ") + operand


def _operand(formula: Formula, level: int) -> str:
    """Put parentheses around an operand that binds less tightly than its place asks for."""
    return f"({text(formula)})" if _level(formula) < level else text(formula)


def _level(formula: Formula) -> int:
    return OPERATORS[formula.op].level if isinstance(formula, (Unary, Binary)) else 99
