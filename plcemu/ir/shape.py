"""Shapes: the structure of variables in memory, by which two programs' variables are matched.

A value is carried from one layout to another if its full name and its type are the same in both.
Types are compared by structure: a structure of another name with the same fields is the same, an
enumeration whose values have other numbers, or an array with other bounds, is not. Where a variable
is not the same as a whole, what is the same within it is carried: fields by name, elements by
subscript.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True)
class Scalar:
    """A single value; its type's text tells all that its bytes mean, such as `ENUM(RED=0)`."""

    type: str
    size: int
    carried: bool = field(default=True, init=False, compare=False)


@dataclass(frozen=True, slots=True)
class Array:
    """Elements at (lowest, highest) subscripts of every dimension, the last one the fastest."""

    element: Shape
    ranges: tuple[tuple[int, int], ...]
    stride: int

    @property
    def size(self) -> int:
        """Bytes of the whole."""
        size = self.stride
        for low, high in self.ranges:
            size *= high - low + 1
        return size

    @property
    def carried(self) -> bool:
        """Whether every byte is carried over."""
        return self.element.carried


@dataclass(frozen=True, slots=True)
class Record:
    """Fields as (name, offset, shape).

    Attributes:
        block: the function block's name in capitals; `STEP` of a step; empty of a structure.
        fields: in order of declaration, without those that are not carried.
        size: in bytes.
        whole: whether no field was left out.
    """

    block: str
    fields: tuple[tuple[str, int, Shape], ...]
    size: int
    whole: bool = True
    carried: bool = field(init=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "carried",
                           self.whole and all(shape.carried for _, _, shape in self.fields))


Shape = Scalar | Array | Record
STEP = "STEP"
STARTED = "__started"
"""The hidden flag of a chart that its initial situation has been taken."""


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable in memory.

    Attributes:
        name: its full name, or a part of one.
        type: its type's name, in the user's spelling.
        shape: its structure.
        offset: in the memory block.
    """

    name: str
    type: str
    shape: Shape
    offset: int

    @property
    def size(self) -> int:
        """In bytes."""
        return self.shape.size


Move = tuple[int, int, int]
"""From an offset of the old block, to one of the new block, how many bytes."""


@dataclass(slots=True)
class Match:
    """What two sets of variables have in common, by names as long as one name can tell it.

    Attributes:
        moves: the bytes to carry over.
        kept: what is carried.
        added: what begins at its initial value.
        dropped: what is no more, or of another type.
    """

    moves: list[Move] = field(default_factory=list)
    kept: list[str] = field(default_factory=list)
    added: list[str] = field(default_factory=list)
    dropped: list[str] = field(default_factory=list)

    def carry(self, old: bytes | memoryview, new: Any) -> None:
        """Copy what is kept from the old block into the new one."""
        for source, target, size in self.moves:
            new[target:target + size] = bytes(old[source:source + size])

    def place(self, offset: int, size: int) -> int | None:
        """Return where bytes of the old block stand in the new one; None if they are not kept."""
        for source, target, length in self.moves:
            if source <= offset and offset + size <= source + length:
                return target + offset - source
        return None


def match(old: Iterable[Variable], new: Iterable[Variable]) -> Match:
    """Match two sets of variables by name and type."""
    found, left = Match(), {v.name.casefold(): v for v in old}
    for variable in new:
        before = left.pop(variable.name.casefold(), None)
        if before is None:
            _tell(found.added, variable.name)
        else:
            _pair(found, variable.name, before.shape, before.offset, variable.shape,
                  variable.offset)
    for variable in left.values():
        _tell(found.dropped, variable.name)
    found.moves = _joined(found.moves)
    return found


def _tell(names: list[str], name: str) -> None:
    """Add a name unless it is one of the compiler's own."""
    if "__" not in name or not any(p.startswith("__") for p in name.split(".")):
        names.append(name)


def _pair(found: Match, name: str, old: Shape, at: int, new: Shape, to: int) -> None:
    """Match two variables of one name; what is kept as a whole is told by its name alone."""
    if old == new and new.carried:
        found.moves.append((at, to, new.size))
        _tell(found.kept, name)
        return
    inner = Match()
    if isinstance(old, Record) and isinstance(new, Record) and old.block == new.block:
        _pair_fields(inner, name, old, at, new, to)
    elif isinstance(old, Array) and isinstance(new, Array) and len(old.ranges) == len(new.ranges):
        _pair_elements(inner, name, old, at, new, to)
    if not inner.moves:
        _tell(found.added, name)
        _tell(found.dropped, name)
        return
    found.moves += inner.moves
    if inner.added or inner.dropped:
        found.kept += inner.kept
        found.added += inner.added
        found.dropped += inner.dropped
    else:
        _tell(found.kept, name)


def _pair_fields(found: Match, name: str, old: Record, at: int, new: Record, to: int) -> None:
    left = {key.casefold(): (key, offset, shape) for key, offset, shape in old.fields}
    for key, offset, shape in new.fields:
        before = left.pop(key.casefold(), None)
        if before is None:
            _tell(found.added, f"{name}.{key}")
        else:
            _pair(found, f"{name}.{key}", before[2], at + before[1], shape, to + offset)
    for key, _, _ in left.values():
        _tell(found.dropped, f"{name}.{key}")


def _pair_elements(found: Match, name: str, old: Array, at: int, new: Array, to: int) -> None:
    """Match the elements whose subscripts both arrays have; those of one kind go row by row."""
    common = [(max(a[0], b[0]), min(a[1], b[1]))
              for a, b in zip(old.ranges, new.ranges, strict=True)]
    if any(low > high for low, high in common):
        return
    plain = old.element == new.element and new.element.carried and old.stride == new.stride
    if plain:
        low, high = common[-1]
        for row in _subscripts([*common[:-1], (low, low)]):
            found.moves.append((at + _distance(old, row), to + _distance(new, row),
                                (high - low + 1) * new.stride))
        found.kept.append(_stretch(name, common))
    else:
        for each in _subscripts(common):
            _pair(found, f"{name}[{','.join(map(str, each))}]", old.element,
                  at + _distance(old, each), new.element, to + _distance(new, each))
    for names, ranges in ((found.dropped, old.ranges), (found.added, new.ranges)):
        if tuple(common) != ranges:
            names.append(f"{name}, the elements outside {_stretch('', common)}")


def _stretch(name: str, ranges: Iterable[tuple[int, int]]) -> str:
    return f"{name}[{','.join(f'{low}..{high}' for low, high in ranges)}]"


def _subscripts(ranges: Iterable[tuple[int, int]]) -> Iterator[tuple[int, ...]]:
    return itertools.product(*(range(low, high + 1) for low, high in ranges))


def _distance(of: Array, subscripts: Sequence[int]) -> int:
    """Return how many bytes after the first element another one stands."""
    number = 0
    for (low, high), n in zip(of.ranges, subscripts, strict=True):
        number = number * (high - low + 1) + n - low
    return number * of.stride


def _joined(moves: list[Move]) -> list[Move]:
    """Join moves that follow each other in both blocks."""
    joined: list[Move] = []
    for source, target, size in sorted(moves):
        if joined:
            first, to, length = joined[-1]
            if first + length == source and to + length == target:
                joined[-1] = (first, to, length + size)
                continue
        joined.append((source, target, size))
    return joined


# ---------------------------------------------------------------- charts


@dataclass(frozen=True, slots=True)
class ChartCells:
    """The cells of one SFC.

    Attributes:
        name: of the instance that it is the body of.
        started: offset of the flag that the initial situation was taken.
        steps: (full name, offset of the flag X) of every step.
    """

    name: str
    started: int
    steps: tuple[tuple[str, int], ...]


def charts(variables: Sequence[Variable]) -> list[ChartCells]:
    """Return every chart among variables, those inside function blocks too."""
    groups: dict[str, list[tuple[str, int, Shape]]] = {}
    for variable in variables:
        owner, _, name = variable.name.rpartition(".")
        groups.setdefault(owner, []).append((name, variable.offset, variable.shape))
    found: list[ChartCells] = []
    for owner, cells in groups.items():
        _find_charts(found, owner, cells, 0)
    return found


def _find_charts(found: list[ChartCells], owner: str, cells: Iterable[tuple[str, int, Shape]],
                 base: int) -> None:
    started, steps = None, []
    for name, offset, shape in cells:
        full, at = f"{owner}.{name}" if owner else name, base + offset
        if name == STARTED:
            started = at
        elif isinstance(shape, Record) and shape.block == STEP:
            flag = next(o for key, o, _ in shape.fields if key == "X")
            steps.append((full, at + flag))
        else:
            _look_inside(found, full, shape, at)
    if started is not None:
        found.append(ChartCells(owner, started, tuple(steps)))


def _look_inside(found: list[ChartCells], name: str, shape: Shape, at: int) -> None:
    if isinstance(shape, Record):
        _find_charts(found, name, shape.fields, at)
    elif isinstance(shape, Array) and not isinstance(shape.element, Scalar):
        for each in _subscripts(shape.ranges):
            _look_inside(found, f"{name}[{','.join(map(str, each))}]", shape.element,
                         at + _distance(shape, each))


# ---------------------------------------------------------------- as plain values


def to_plain(shape: Shape) -> Any:
    """Return a shape as lists and numbers, as JSON knows them."""
    if isinstance(shape, Scalar):
        return [shape.type, shape.size]
    if isinstance(shape, Array):
        return [[list(r) for r in shape.ranges], shape.stride, to_plain(shape.element)]
    return {"block": shape.block, "size": shape.size, "whole": shape.whole,
            "fields": [[name, offset, to_plain(each)] for name, offset, each in shape.fields]}


def from_plain(plain: Any) -> Shape:
    """Return the shape that `to_plain` made plain."""
    if isinstance(plain, dict):
        fields = tuple((str(name), int(offset), from_plain(each))
                       for name, offset, each in plain["fields"])
        return Record(plain["block"], fields, plain["size"], plain["whole"])
    if len(plain) == 2:
        return Scalar(plain[0], plain[1])
    return Array(from_plain(plain[2]), tuple((low, high) for low, high in plain[0]), plain[1])
