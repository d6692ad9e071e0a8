"""Bind formulas to tags, check their types, and compile their timeless parts.

A compiled state formula is a function of two lists, the values now and the values just before
this instant, both by tag index. `rise`, `fall` and `changed` compare the two; everything else
looks at the first only. Given the same list twice it tells what holds once the instant is over.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from plcemu.base.errors import UnknownNameError
from plcemu.base.spans import Diagnostic
from plcemu.base.tags import TagTable
from plcemu.base.types import Value
from plcemu.monitor.codes import diagnostic
from plcemu.monitor.formula import (
    OPERATORS,
    Binary,
    Duration,
    Formula,
    Kind,
    Literal,
    TagRef,
    Unary,
    is_state,
    tag_refs,
    walk,
)

Values = Sequence[Value | None]
StateFunction = Callable[[Values, Values], bool]

_TRUTH, _NUMBER, _TEXT = "truth value", "number", "character string"
_KIND_OF_TYPE = {"BOOL": _TRUTH, "STRING": _TEXT, "WSTRING": _TEXT}
_PYTHON = {"!": "(not {0})", "&": "({0} and {1})", "|": "({0} or {1})",
           "->": "(not {0} or {1})", "<->": "(bool({0}) is bool({1}))",
           "=": "({0} == {1})", "!=": "({0} != {1})", "<": "({0} < {1})", "<=": "({0} <= {1})",
           ">": "({0} > {1})", ">=": "({0} >= {1})", "+": "({0} + {1})", "-": "({0} - {1})",
           "*": "({0} * {1})", "/": "({0} / {1})", "negate": "(-{0})"}
_PULSES = {"rise": "({now} and not {before})", "fall": "({before} and not {now})",
           "changed": "({now} != {before})"}


@dataclass(frozen=True, slots=True)
class State:
    """A compiled state formula.

    Attributes:
        formula: its source.
        holds: the compiled function.
        pulsed: whether `rise`, `fall` or `changed` occur, so that it may hold for one instant.
    """

    formula: Formula
    holds: StateFunction
    pulsed: bool


class Binder:
    """Resolves the tags of formulas in one tag table."""

    def __init__(self, tags: TagTable, diagnostics: list[Diagnostic]) -> None:
        self.tags = tags
        self.diagnostics = diagnostics
        self.indices: dict[str, int] = {}

    def check(self, formula: Formula) -> list[int]:
        """Resolve all tags and check all types; return the tags' indices in textual order."""
        found: dict[int, None] = {}
        for ref in tag_refs(formula):
            try:
                self.indices[ref.name] = self.tags.find(ref.name)
                found[self.indices[ref.name]] = None
            except UnknownNameError as error:
                self.diagnostics.append(diagnostic("M0010", ref.span, found=str(error)))
        if not self.diagnostics:
            self.expect(formula, _TRUTH)
        return list(found)

    def expect(self, formula: Formula, *kinds: str) -> str:
        """Check that a part is of one of these kinds, and return its kind."""
        found = self.kind(formula)
        if found not in kinds:
            hint = "compare it, as in x = 1" if _TRUTH in kinds and found == _NUMBER else ""
            self.diagnostics.append(diagnostic(
                "M0011", formula.span, hint, found=f"'{formula}'", kind=found,
                expected=" or ".join(kinds)))
        return found

    def kind(self, formula: Formula) -> str:
        """Return what a part is: a truth value, a number or a character string."""
        if isinstance(formula, TagRef):
            index = self.indices.get(formula.name)
            if index is None:
                index = self.indices[formula.name] = self.tags.find(formula.name)
            return _KIND_OF_TYPE.get(self.tags[index].type, _NUMBER)
        if isinstance(formula, Duration):
            return _NUMBER
        if isinstance(formula, Literal):
            return {bool: _TRUTH, str: _TEXT}.get(type(formula.value), _NUMBER)
        return self.operation(formula)

    def operation(self, formula: Unary | Binary) -> str:
        kind = OPERATORS[formula.op].kind
        if formula.op == "changed" and isinstance(formula, Unary):
            self.expect(formula.arg, _TRUTH, _NUMBER, _TEXT)
        elif kind is Kind.COMPARISON and isinstance(formula, Binary):
            left = self.expect(formula.left, _TRUTH, _NUMBER, _TEXT)
            # A BOOL compares with 0 and 1: recorded traces cannot tell the two apart.
            alike = (_TEXT,) if left == _TEXT else (_TRUTH, _NUMBER)
            self.expect(formula.right, *alike)
        else:
            wanted = (_NUMBER, _TRUTH) if kind is Kind.ARITHMETIC else (_TRUTH,)
            for part in (formula.left, formula.right) if isinstance(formula, Binary) \
                    else (formula.arg,):
                self.expect(part, *wanted)
        return _NUMBER if kind is Kind.ARITHMETIC else _TRUTH

    def compile(self, formula: Formula) -> State:
        """Compile a checked state formula."""
        assert is_state(formula)
        pulsed = any(isinstance(p, Unary) and p.op in _PULSES for p in walk(formula))
        code = compile(f"lambda now, before: {self.expression(formula, 'now')}",
                       f"<{formula}>", "eval")
        return State(formula, eval(code, {"bool": bool, "inf": math.inf}), pulsed)

    def expression(self, formula: Formula, state: str) -> str:
        """Return a Python expression over the lists `now` and `before`."""
        if isinstance(formula, TagRef):
            return f"{state}[{self.indices[formula.name]}]"
        if isinstance(formula, (Duration, Literal)):
            return repr(formula.ns if isinstance(formula, Duration) else formula.value)
        if isinstance(formula, Unary) and formula.op in _PULSES:
            return _PULSES[formula.op].format(now=self.expression(formula.arg, "now"),
                                              before=self.expression(formula.arg, "before"))
        parts = (formula.left, formula.right) if isinstance(formula, Binary) else (formula.arg,)
        return _PYTHON[formula.op].format(*(self.expression(p, state) for p in parts))


def values_of(refs: Sequence[int], tags: TagTable, values: Values) -> dict[str, Value | None]:
    """Return the values of tags by their full names."""
    return {tags[index].name: values[index] for index in refs}
