"""State formulas as Promela, over the variables that stand for memory and the plant's facts.

The monitors' numbers have no end, Promela's have 32 bits: whatever may be larger is refused.
"""

from __future__ import annotations

from collections.abc import Sequence

from plcemu.base.types import StringType, type_of
from plcemu.monitor.bind import Binder
from plcemu.monitor.formula import Binary, Call, Formula, Literal, TagRef, Unary, children
from plcemu.verify.predicates import Predicates
from plcemu.verify.promela.code import Cells, NoPromela
from plcemu.verify.promela.operations import LARGEST

_INFIX = {"&": "&&", "|": "||", "<->": "==", "xor": "!=", "=": "==", "!=": "!=", "<": "<",
          "<=": "<=", ">": ">", ">=": ">=", "+": "+", "-": "-", "*": "*", "MOD": "%"}
_TRUTHS = ("&", "|", "<->", "xor", "=", "!=", "<", "<=", ">", ">=")

Said = tuple[str, int, int]
"""An expression, and the least and the largest value that it may have."""


class FormulaWriter:
    """Writes state formulas.

    Args:
        predicates: knows the tags.
        cells: the variables that stand for memory.
        facts: the numbers of the plant's facts that are asked for, in the order of their columns;
            extended by what is written.
        whole: for each of the plant's facts the least and the largest value; None if it is no
            whole number.
    """

    def __init__(self, predicates: Predicates, cells: Cells,
                 whole: Sequence[tuple[int, int] | None]) -> None:
        self._predicates, self._cells, self._whole = predicates, cells, whole
        self.facts: list[int] = []

    def write(self, formula: Formula) -> str:
        """Return a state formula as an expression.

        Raises:
            NoPromela: it asks for what Promela does not have.
        """
        self._binder = Binder(self._predicates.tags, [])
        return self._said(self._binder.check(formula))[0]

    def _said(self, formula: Formula) -> Said:
        if isinstance(formula, TagRef):
            return self._tag(self._binder.names.indices[formula.name], formula)
        if isinstance(formula, Literal) and isinstance(formula.value, int):
            return self._fitting(str(int(formula.value)), int(formula.value), int(formula.value),
                                 formula)
        parts = [self._said(part) for part in children(formula)]
        if isinstance(formula, Unary) and formula.op in ("!", "negate"):
            (text, low, high), = parts
            return (f"!({text})", 0, 1) if formula.op == "!" else \
                self._fitting(f"(0 - ({text}))", -high, -low, formula)
        if isinstance(formula, Binary) and formula.op == "->":
            return f"(!({parts[0][0]}) || ({parts[1][0]}))", 0, 1
        if isinstance(formula, Binary) and formula.op in _INFIX:
            return self._infix(formula, *parts)
        if isinstance(formula, Call) and formula.name in ("abs", "min", "max"):
            return self._fitting(*self._function(formula.name, parts), formula)
        raise NoPromela(f"{formula} cannot be said in Promela")

    def _tag(self, index: int, formula: TagRef) -> Said:
        slots = self._predicates.slots
        if index < len(slots):
            row = type_of(slots[index].tag.type)
            if isinstance(row, StringType) or row.kind == "float" or row.size > 4 \
                    or row.machine == "u32":
                raise NoPromela(f"{formula} is of type {row.name}, and formulas for SPIN have "
                                "whole numbers of 32 bits with a sign")
            return self._cells.at(slots[index].offset, row.machine).name, row.low, row.high
        fact = index - len(slots)
        limits = self._whole[fact]
        if limits is None:
            raise NoPromela(f"{formula} is no whole number")
        if fact not in self.facts:
            self.facts.append(fact)
        return f"fact({self.facts.index(fact)})", *limits

    def _infix(self, formula: Binary, left: Said, right: Said) -> Said:
        op = formula.op
        text = f"({left[0]} {_INFIX[op]} {right[0]})"
        if op in _TRUTHS:
            return text, 0, 1
        if op == "MOD":
            if right[1] <= 0 <= right[2]:
                raise NoPromela(f"{formula} may divide by zero")
            return text, min(left[1], 0), max(left[2], 0)
        ends = [_of(op, a, b) for a in left[1:] for b in right[1:]]
        return self._fitting(text, min(ends), max(ends), formula)

    @staticmethod
    def _function(name: str, parts: Sequence[Said]) -> Said:
        text, low, high = parts[0]
        if name == "abs":
            return f"({text} < 0 -> 0 - {text} : {text})", 0, max(abs(low), abs(high))
        sign, pick = ("<", min) if name == "min" else (">", max)
        for other, least, most in parts[1:]:
            text = f"({text} {sign} {other} -> {text} : {other})"
            low, high = pick(low, least), pick(high, most)
        return text, low, high

    @staticmethod
    def _fitting(text: str, low: int, high: int, formula: Formula) -> Said:
        if low < -LARGEST or high > LARGEST:
            raise NoPromela(f"{formula} may have more than 32 bits")
        return (f"({text})" if text.startswith("-") else text), low, high


def _of(op: str, a: int, b: int) -> int:
    return a + b if op == "+" else a - b if op == "-" else a * b
