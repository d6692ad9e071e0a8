"""Located variables: which elements of an image area a type takes (IEC 61131-3, 2.4.1.1, 2.4.3.1).

An array, structure or string with an address takes contiguous elements from it on, with the bytes
that it has in memory: fields stand at their alignment, and a string begins with its length in 16
bits.
"""

from __future__ import annotations

from plcemu.base.areas import AREA_ELEMENTS, SIZES, Address
from plcemu.base.types import ElementaryType, StringType
from plcemu.lang.types import ArrayType, BlockType, Type, root


def misfit(of: Type, address: Address) -> str:
    """Return why a variable of a type cannot stand at an address; empty if it can."""
    bits = element_bits(address)
    of = root(of)
    if isinstance(of, BlockType) and of.kind != "STRUCT":
        return "a function block instance has no address"
    unit = _unit(of)
    if isinstance(unit, ElementaryType) and unit.bits != bits:
        return f"{address} holds {bits} bit{'s' if bits > 1 else ''}, {unit.name} needs {unit.bits}"
    if not isinstance(unit, ElementaryType):
        return _large_misfit(unit, bits == 1)
    return ""


def element_bits(address: Address) -> int:
    """Return how many bits an element of an address's area holds."""
    return 1 if address.area[1] == "X" else 8 * SIZES[address.area[1]]


def count_elements(of: Type, address: Address) -> int:
    """Return how many elements of an address's area a type takes."""
    return -(-of.size // SIZES[address.area[1]])


def is_inside(of: Type, address: Address) -> bool:
    """Whether a variable that begins at an address ends in its area too."""
    limit = AREA_ELEMENTS * (8 if address.area[1] == "X" else 1)
    return address.index + count_elements(of, address) <= limit


def leaf_address(first: Address, distance: int, of: ElementaryType | StringType) -> str:
    """Return the address of a value, `distance` bytes after the first; empty if it has none."""
    width = SIZES[first.area[1]]
    if not isinstance(of, ElementaryType) or of.bits != element_bits(first) or distance % width:
        return ""
    return str(Address(first.area, first.index + distance // width))


def _unit(of: Type) -> Type:
    """Return what an array's elements are at last."""
    while isinstance(of, ArrayType):
        of = root(of.element)
    return of


def _large_misfit(of: Type, is_bits: bool) -> str:
    """Return why a structure or string cannot stand in an area: bits are in X areas only."""
    found = _has_bool(of)
    if is_bits and found != {True}:
        return f"an area of bits holds BOOL values only, {of.name} has others"
    if not is_bits and True in found:
        return f"{of.name} has BOOL fields, which stand in areas of bits (%MX) only"
    return ""


def _has_bool(of: Type) -> set[bool]:
    """Return whether the values in a type are BOOL: {True}, {False}, or both."""
    found: set[bool] = set()
    pending: list[Type] = [of]
    while pending:
        each = _unit(root(pending.pop()))
        if isinstance(each, BlockType):
            pending += [field.type for field in each.fields.values()]
        else:
            found.add(each.kind == "bool")
    return found
