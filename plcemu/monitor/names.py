"""What the names in a formula stand for: tags, elements of arrays, values of enumerations.

Judges and provers share this: `resolve` gives a formula in which every value of an enumeration
has become its number.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from plcemu.base.errors import UnknownNameError
from plcemu.base.spans import Diagnostic
from plcemu.base.tags import Tag, TagTable
from plcemu.monitor.codes import diagnostic
from plcemu.monitor.formula import (
    OPERATORS,
    Binary,
    Call,
    Element,
    Formula,
    Kind,
    Literal,
    TagRef,
    Unary,
    children,
    rebuilt,
    walk,
)


@dataclass(frozen=True, slots=True)
class Cells:
    """The tags of an array that is asked for an element at computed indices.

    Attributes:
        at: the tag's index by the element's indices.
    """

    at: dict[tuple[int, ...], int]


class Names:
    """Resolves the names of formulas in one tag table; mistakes are collected.

    Attributes:
        tags: the table.
        indices: tag index by the name as it was written.
        cells: the tags of arrays by (array, rest) as written.
    """

    def __init__(self, tags: TagTable, diagnostics: list[Diagnostic]) -> None:
        self.tags, self.diagnostics = tags, diagnostics
        self.indices: dict[str, int] = {}
        self.cells: dict[tuple[str, str], Cells] = {}

    def resolve(self, formula: Formula) -> Formula:
        """Return the formula with numbers for values of enumerations, all other names looked up."""
        known = self._enumerated(formula)
        for part in walk(known):
            if isinstance(part, TagRef) and part.name not in self.indices:
                self._find(part)
            elif isinstance(part, Element):
                self._find_cells(part)
        return known

    def used(self, formula: Formula) -> list[int]:
        """Return the indices of the tags of a resolved formula in textual order, each once."""
        found: dict[int, None] = {}
        for part in walk(formula):
            if isinstance(part, TagRef) and part.name in self.indices:
                found[self.indices[part.name]] = None
            elif isinstance(part, Element):
                cells = self.cells.get((part.array, part.rest))
                found |= dict.fromkeys(cells.at.values() if cells else ())
        return list(found)

    def tag_of(self, part: Formula) -> Tag | None:
        """Return the tag that a part shows the value of, now or earlier, if it does."""
        if isinstance(part, Unary) and part.op == "previous":
            return self.tag_of(part.arg)
        if isinstance(part, Call) and part.name == "ago":
            return self.tag_of(part.args[0])
        if isinstance(part, Element):
            self._find_cells(part)
            cells = self.cells.get((part.array, part.rest))
            return self.tags[next(iter(cells.at.values()))] if cells else None
        if isinstance(part, TagRef) and part.name in self.tags:
            return self.tags[part.name]
        return None

    def _enumerated(self, formula: Formula) -> Formula:
        parts: Sequence[Formula] = [self._enumerated(part) for part in children(formula)]
        if isinstance(formula, Binary) and OPERATORS[formula.op].kind is Kind.COMPARISON:
            left, right = parts
            parts = [self._value(left, self.tag_of(right)), self._value(right, self.tag_of(left))]
        return rebuilt(formula, parts)

    def _value(self, part: Formula, other: Tag | None) -> Formula:
        """Return a name as the number of a value of the other side's enumeration, if it is one."""
        if not isinstance(part, TagRef) or other is None:
            return part
        name = part.name.rpartition("#")[2].casefold()
        for known, value in other.values:
            if known.casefold() == name:
                return Literal(value, part.span)
        if "#" in part.name and other.type.startswith("STRING"):
            # A recording from elsewhere may hold the names themselves.
            return Literal(part.name.rpartition("#")[2], part.span)
        return part

    def _find(self, ref: TagRef) -> None:
        try:
            self.indices[ref.name] = self.tags.find(ref.name)
        except UnknownNameError as error:
            self.diagnostics.append(diagnostic("M0010", ref.span, found=str(error)))

    def _find_cells(self, part: Element) -> None:
        key = (part.array, part.rest)
        if key in self.cells:
            return
        pattern = re.compile(rf"(?:.*\.)?{re.escape(part.array)}\[(-?\d+(?:,-?\d+)*)\]"
                             rf"{re.escape(part.rest)}", re.IGNORECASE)
        found = [m[1] for tag in self.tags if (m := pattern.fullmatch(tag.name))]
        at = {tuple(map(int, where.split(","))): self.tags.find(f"{part.array}[{where}]{part.rest}")
              for where in dict.fromkeys(found)}
        at = {where: index for where, index in at.items() if len(where) == len(part.indices)}
        if at:
            self.cells[key] = Cells(at)
        else:
            self.diagnostics.append(diagnostic(
                "M0010", part.span, found=f"there is no array {part.array!r} with elements "
                f"{part.rest or 'of their own'} and {len(part.indices)} indices"))
