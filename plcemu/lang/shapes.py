"""Types to shapes: what of a variable has a meaning that another program can share."""

from __future__ import annotations

from plcemu.base.types import ElementaryType, StringType
from plcemu.ir.shape import STEP, Array, Record, Scalar, Shape
from plcemu.lang.types import ArrayType, BlockType, EnumType, SubrangeType, Type

_LEFT_OUT = ("VAR_IN_OUT", "VAR_TEMP")
"""Sections whose cells mean nothing from one call to the next."""


class Shapes:
    """Makes shapes, each type's once.

    Constants are left out: an edited program's own values hold.

    Args:
        retained: leave out what is declared NON_RETAIN too.
    """

    def __init__(self, retained: bool = False) -> None:
        self._retained = retained
        self._made: dict[int, tuple[BlockType, Record]] = {}

    def of(self, of: Type) -> Shape:
        """Return a type's shape."""
        if isinstance(of, ArrayType):
            return Array(self.of(of.element), of.ranges, of.stride)
        if isinstance(of, BlockType):
            if id(of) not in self._made:
                self._made[id(of)] = (of, self._record(of))
            return self._made[id(of)][1]
        return Scalar(_text(of), of.size)

    def _record(self, of: BlockType) -> Record:
        fields = [each for each in of.fields.values()
                  if each.section not in _LEFT_OUT and not each.constant
                  and not (self._retained and each.retain is False)]
        name = {"STRUCT": "", "STEP": STEP}.get(of.kind, of.name.upper())
        return Record(name, tuple((x.name, x.offset, self.of(x.type)) for x in fields), of.size,
                      len(fields) == len(of.fields))


def _text(of: ElementaryType | StringType) -> str:
    """Return all that the bytes of a value mean: an enumeration's numbers, a subrange's limits."""
    if isinstance(of, EnumType):
        return f"({','.join(f'{name.upper()}={value}' for name, value in of.members)})"
    if isinstance(of, SubrangeType):
        base = of.base
        limited = (of.first, of.last) != (base.low, base.high) and base.kind in ("int", "uint")
        return f"{_text(base)}({of.first}..{of.last})" if limited else _text(base)
    return of.name
