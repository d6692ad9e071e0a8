"""Linear constraints over named quantities, with exact rational numbers, as text and as values."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

TEXT_LIMIT = 10_000
"""Characters of a text of constraints."""

_TOKEN = re.compile(r"\s*(?:(?P<number>\d+(?:\.\d+)?(?:/\d+)?)|(?P<name>[A-Za-z_]\w*)"
                    r"|(?P<sign><=|>=|==|<|>|&|\*|\+|-))")


class LinearError(ValueError):
    """A text that is no conjunction of linear constraints."""


@dataclass(frozen=True, slots=True)
class Term:
    """A linear expression: the sum of `factor * name`, plus a constant."""

    factors: tuple[tuple[str, Fraction], ...] = ()
    constant: Fraction = Fraction(0)

    @classmethod
    def of(cls, factors: Mapping[str, Fraction], constant: Fraction = Fraction(0)) -> Term:
        """Return an expression in normal form: names in order, no zero factors."""
        return cls(tuple(sorted((n, f) for n, f in factors.items() if f)), constant)

    def minus(self, other: Term) -> Term:
        """Return the difference."""
        factors = dict(self.factors)
        for name, factor in other.factors:
            factors[name] = factors.get(name, Fraction(0)) - factor
        return Term.of(factors, self.constant - other.constant)

    def times(self, factor: Fraction) -> Term:
        """Return a multiple."""
        return Term.of({n: f * factor for n, f in self.factors}, self.constant * factor)

    @property
    def names(self) -> set[str]:
        """The quantities in it."""
        return {name for name, _ in self.factors}


@dataclass(frozen=True, slots=True)
class Constraint:
    """`term <= 0`, `term < 0` or `term == 0`."""

    term: Term
    relation: str

    @property
    def negations(self) -> tuple[Constraint, ...]:
        """Constraints of which one holds where this one does not, and none where it does."""
        back = self.term.times(Fraction(-1))
        if self.relation == "==":
            return Constraint(self.term, "<"), Constraint(back, "<")
        return (Constraint(back, "<" if self.relation == "<=" else "<="),)


Constraints = tuple[Constraint, ...]


def parse_constraints(text: str) -> Constraints:
    """Read a conjunction such as `10.945 <= c <= 11.055 & x - 2*y == 1/3`; empty text is true.

    Raises:
        LinearError: the text is none; says where and what was expected.
    """
    if len(text) > TEXT_LIMIT:
        raise LinearError(f"a text of {len(text)} characters; at most {TEXT_LIMIT} are read")
    reader = _Reader(text)
    found: list[Constraint] = []
    if reader.kind != "end":
        found += reader.chain()
        while reader.take("&"):
            found += reader.chain()
    reader.expect_end()
    return tuple(found)


def parse_term(text: str) -> Term:
    """Read a linear expression such as `x - 2*y + 1/3`; raises `LinearError`."""
    reader = _Reader(text)
    term = reader.sum()
    reader.expect_end()
    return term


class _Reader:
    """Reads one text from left to right."""

    _RELATIONS = ("<=", ">=", "==", "<", ">")

    def __init__(self, text: str) -> None:
        self._text = text
        self._at = 0
        self.kind = self.value = ""
        self._next()

    def _next(self) -> None:
        found = _TOKEN.match(self._text, self._at)
        if found is None:
            if self._text[self._at:].strip():
                raise self._wrong("a number, a name or an operator")
            self.kind, self.value = "end", ""
            return
        self.kind = str(found.lastgroup)
        self.value = found.group(self.kind)
        self._at = found.end()

    def _wrong(self, expected: str) -> LinearError:
        return LinearError(f"in {self._text!r} at character {self._at}: found "
                           f"{self.value or 'the end'!r}, expected {expected}")

    def take(self, sign: str) -> bool:
        """Pass over a sign if it comes next."""
        if self.kind == "sign" and self.value == sign:
            self._next()
            return True
        return False

    def expect_end(self) -> None:
        """Demand that nothing follows."""
        if self.kind != "end":
            raise self._wrong("& or the end")

    def chain(self) -> list[Constraint]:
        """Read `a <= b < c`: neighbours are compared."""
        left, found = self.sum(), []
        while self.kind == "sign" and self.value in self._RELATIONS:
            relation = self.value
            self._next()
            right = self.sum()
            difference = left.minus(right) if relation[0] != ">" else right.minus(left)
            found.append(Constraint(difference, {">": "<", ">=": "<="}.get(relation, relation)))
            left = right
        if not found:
            raise self._wrong("<=, <, ==, >= or >")
        return found

    def sum(self) -> Term:
        """Read a sum of products."""
        factors: dict[str, Fraction] = {}
        constant = Fraction(0)
        sign = Fraction(-1 if self.take("-") else 1)
        while True:
            number, name = self._product()
            if name:
                factors[name] = factors.get(name, Fraction(0)) + sign * number
            else:
                constant += sign * number
            if self.take("+"):
                sign = Fraction(1)
            elif self.take("-"):
                sign = Fraction(-1)
            else:
                return Term.of(factors, constant)

    def _product(self) -> tuple[Fraction, str]:
        number = Fraction(1)
        if self.kind == "number":
            number = self._number()
            if not self.take("*"):
                return number, ""
        if self.kind != "name":
            raise self._wrong("a number or a name")
        name = self.value
        self._next()
        return number, name

    def _number(self) -> Fraction:
        above, _, below = self.value.partition("/")
        if below and not int(below):
            raise self._wrong("a number that is not divided by zero")
        self._next()
        return Fraction(above) / int(below or 1)
