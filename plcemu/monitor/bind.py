"""Bind formulas to tags, check their types, and compile their timeless parts.

A compiled state formula is a function of two lists, the values now and the values just before
this instant, both by tag index. `rise`, `fall`, `changed` and `previous` look at the second;
everything else at the first only. Given the same list twice it tells what holds once the instant
is over. It answers True, False, or None where it hinges on a value that is not known (of bad
quality), after Kleene's strong tables; the quick form may only be asked while all are known.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from plcemu.base.spans import Diagnostic
from plcemu.base.tags import TagTable
from plcemu.base.types import Value
from plcemu.monitor.codes import diagnostic
from plcemu.monitor.formula import (
    OPERATORS,
    Binary,
    Call,
    Duration,
    Element,
    Formula,
    Kind,
    Literal,
    TagRef,
    Unary,
    children,
    is_state,
    walk,
)
from plcemu.monitor.linear import looks_back
from plcemu.monitor.names import Cells, Names

Values = Sequence[Value | None]
StateFunction = Callable[[Values, Values], bool | None]

_TRUTH, NUMBER, _TEXT = "truth value", "number", "character string"
_ANY = (_TRUTH, NUMBER, _TEXT)
_PYTHON = {"!": "(not {0})", "&": "({0} and {1})", "|": "({0} or {1})",
           "->": "(not {0} or {1})", "<->": "(bool({0}) is bool({1}))",
           "xor": "(bool({0}) is not bool({1}))",
           "=": "({0} == {1})", "!=": "({0} != {1})", "<": "({0} < {1})", "<=": "({0} <= {1})",
           ">": "({0} > {1})", ">=": "({0} >= {1})", "+": "({0} + {1})", "-": "({0} - {1})",
           "*": "({0} * {1})", "/": "({0} / {1})", "MOD": "fmod({0}, {1})", "negate": "(-{0})",
           "abs": "abs({0})", "min": "min({all})", "max": "max({all})",
           "rise": "({0} and not {before})", "fall": "({before} and not {0})",
           "changed": "({0} != {before})", "previous": "{before}"}


def _fmod(a: Any, b: Any) -> Any:
    """Return the rest of a division, with the sign of the dividend as in IEC 61131-3."""
    return int(math.copysign(abs(a) % abs(b), a)) if isinstance(a, int) and isinstance(b, int) \
        else math.fmod(a, b)


def _strict(function: Callable[..., Any]) -> Callable[..., Any]:
    return lambda *parts: None if None in parts else function(*parts)


def _not(p: Any) -> bool | None:
    return None if p is None else not p


def _and(p: Any, q: Any) -> bool | None:
    if (p is not None and not p) or (q is not None and not q):
        return False
    return None if p is None or q is None else True


def _or(p: Any, q: Any) -> bool | None:
    return _not(_and(_not(p), _not(q)))


_KLEENE: dict[str, Callable[..., Any]] = {
    "!": _not, "&": _and, "|": _or, "->": lambda p, q: _or(_not(p), q),
    "<->": _strict(lambda p, q: bool(p) is bool(q)),
    "xor": _strict(lambda p, q: bool(p) is not bool(q)),
    "=": _strict(operator.eq), "!=": _strict(operator.ne), "<": _strict(operator.lt),
    "<=": _strict(operator.le), ">": _strict(operator.gt), ">=": _strict(operator.ge),
    "+": _strict(operator.add), "-": _strict(operator.sub), "*": _strict(operator.mul),
    "/": _strict(operator.truediv), "MOD": _strict(_fmod), "negate": _strict(operator.neg),
    "abs": _strict(abs), "min": _strict(lambda *p: min(p)), "max": _strict(lambda *p: max(p)),
    "rise": lambda now, before: _and(now, _not(before)),
    "fall": lambda now, before: _and(before, _not(now)),
    "changed": _strict(operator.ne)}


@dataclass(frozen=True)
class State:
    """A compiled state formula.

    Attributes:
        formula: its source.
        tags: the indices of the tags that it reads.
        holds: the compiled function; every tag must have a value.
        pulsed: whether it looks at the values before, so that it may hold for one instant.
    """

    formula: Formula
    tags: tuple[int, ...]
    holds: StateFunction
    pulsed: bool
    binder: Binder

    def __deepcopy__(self, memo: object) -> State:
        """It never changes."""
        return self

    def kleene(self, now: Values, before: Values) -> bool | None:
        """Return the value in three values; tags may be without a value."""
        return self._kleene(now, before)

    @cached_property
    def _kleene(self) -> StateFunction:
        return self.binder.three_valued(self.formula)


@dataclass(frozen=True, slots=True)
class Delay:
    """A tag's value some time before, as a value of its own.

    Attributes:
        source: the tag's index.
        delay_ns: how long before.
        slot: its index in the lists of values, behind the tags.
    """

    source: int
    delay_ns: int
    slot: int


class Binder:
    """Checks and compiles the formulas of one suite; `delays` are shared by all of them."""

    def __init__(self, tags: TagTable, diagnostics: list[Diagnostic],
                 delays: dict[tuple[int, int], Delay] | None = None) -> None:
        self.tags = tags
        self.diagnostics = diagnostics
        self.names = Names(tags, diagnostics)
        self.delays = {} if delays is None else delays

    def check(self, formula: Formula) -> Formula:
        """Resolve all names and check all types; return the formula with its names resolved."""
        known = self.names.resolve(formula)
        if not self.diagnostics:
            self.expect(known, _TRUTH)
        return known

    def used(self, formula: Formula) -> list[int]:
        """Return the indices of all values that a formula reads, delayed ones included."""
        delayed = [self.delay(part).slot for part in walk(formula)
                   if isinstance(part, Call) and part.name == "ago"]
        return self.names.used(formula) + delayed

    def expect(self, formula: Formula, *kinds: str) -> str:
        """Check that a part is of one of these kinds, and return its kind."""
        found = self.kind(formula)
        if found not in kinds:
            hint = "compare it, as in x = 1" if _TRUTH in kinds and found == NUMBER else ""
            self.diagnostics.append(diagnostic(
                "M0011", formula.span, hint, found=f"'{formula}'", kind=found,
                expected=" or ".join(kinds)))
        return found

    def kind(self, formula: Formula) -> str:
        """Return what a part is: a truth value, a number or a character string."""
        if isinstance(formula, (TagRef, Element)):
            for index in children(formula):
                self.expect(index, NUMBER, _TRUTH)
            tag = self.names.tag_of(formula)
            type_ = tag.type.partition("[")[0] if tag else ""
            return {"BOOL": _TRUTH, "STRING": _TEXT, "WSTRING": _TEXT}.get(type_, NUMBER)
        if isinstance(formula, Literal):
            return {bool: _TRUTH, str: _TEXT}.get(type(formula.value), NUMBER)
        if isinstance(formula, Call):
            return self.function(formula)
        if isinstance(formula, (Unary, Binary)):
            return self.operation(formula)
        return NUMBER if isinstance(formula, Duration) else _TRUTH

    def function(self, formula: Call) -> str:
        if formula.name != "ago":
            for part in formula.args:
                self.expect(part, NUMBER, _TRUTH)
            return NUMBER
        tag, back = formula.args
        if not isinstance(tag, TagRef):
            self.diagnostics.append(diagnostic("M0012", tag.span, found=f"'{tag}'",
                                               expected="a tag"))
        if not isinstance(back, Duration) or back.ns <= 0:
            self.diagnostics.append(diagnostic("M0012", back.span, found=f"'{back}'",
                                               expected="a duration such as 5s"))
        return self.kind(tag)

    def operation(self, formula: Unary | Binary) -> str:
        kind = OPERATORS[formula.op].kind
        if isinstance(formula, Unary) and formula.op in ("changed", "previous"):
            found = self.expect(formula.arg, *_ANY)
            return found if formula.op == "previous" else _TRUTH
        if kind is Kind.COMPARISON and isinstance(formula, Binary):
            left = self.expect(formula.left, *_ANY)
            # A BOOL compares with 0 and 1: recorded traces cannot tell the two apart.
            alike = (_TEXT,) if left == _TEXT else (_TRUTH, NUMBER)
            self.expect(formula.right, *alike)
            return _TRUTH
        wanted = (NUMBER, _TRUTH) if kind is Kind.ARITHMETIC else (_TRUTH,)
        for part in children(formula):
            self.expect(part, *wanted)
        return NUMBER if kind is Kind.ARITHMETIC else _TRUTH

    def delay(self, formula: Call) -> Delay:
        """Return the delayed value that `ago(tag, duration)` reads."""
        tag, back = formula.args
        assert isinstance(tag, TagRef) and isinstance(back, Duration)
        key = (self.names.indices[tag.name], back.ns)
        return self.delays.setdefault(key, Delay(*key, len(self.tags) + len(self.delays)))

    def compile(self, formula: Formula) -> State:
        """Compile a checked state formula."""
        assert is_state(formula)
        writer = Writer(self)
        code = compile(f"lambda now, before: {writer.quick(formula, 'now')}",
                       f"<{formula}>", "eval")
        holds: StateFunction = eval(code, writer.scope)
        return State(formula, tuple(self.used(formula)), holds, looks_back(formula), self)

    def three_valued(self, formula: Formula) -> StateFunction:
        """Compile a checked state formula to Kleene's three values."""
        writer = Writer(self)
        code = compile(f"lambda now, before: {writer.kleene(formula, 'now')}",
                       f"<{formula}>", "eval")
        function: StateFunction = eval(code, writer.scope)
        return function


STATE_SCOPE: dict[str, Any] = {"inf": math.inf, "fmod": _fmod}
"""What written expressions may name besides values."""


class Writer:
    """Writes a state formula as a Python expression over the lists `now` and `before`."""

    def __init__(self, binder: Binder) -> None:
        self.binder = binder
        self.scope: dict[str, Any] = {**STATE_SCOPE, "element": _element, "K": _KLEENE}

    def quick(self, formula: Formula, state: str) -> str:
        """Write it for values that are all known."""
        leaf = self.leaf(formula, state, self.quick)
        if leaf:
            return leaf
        name = formula.name if isinstance(formula, Call) else getattr(formula, "op", "")
        parts = [self.quick(part, state) for part in children(formula)]
        before = self.quick(children(formula)[0], "before")
        return _PYTHON[name].format(*parts, before=before, all=", ".join([*parts, parts[0]]))

    def kleene(self, formula: Formula, state: str) -> str:
        """Write it for values of which some may be None."""
        leaf = self.leaf(formula, state, self.kleene)
        if leaf:
            return leaf
        name = formula.name if isinstance(formula, Call) else getattr(formula, "op", "")
        if name == "previous":
            return self.kleene(children(formula)[0], "before")
        parts = [self.kleene(part, state) for part in children(formula)]
        if isinstance(formula, Unary) and OPERATORS[name].kind is Kind.PULSE:
            parts.append(self.kleene(formula.arg, "before"))
        return f"K[{name!r}]({', '.join(parts)})"

    def leaf(self, formula: Formula, state: str, write: Callable[[Formula, str], str]) -> str:
        """Write what has no operator; empty for the rest."""
        if isinstance(formula, TagRef):
            return self.value(self.binder.names.indices[formula.name], state)
        if isinstance(formula, Literal):
            return repr(formula.value)
        if isinstance(formula, Duration):
            return repr(formula.ns)
        if isinstance(formula, Call) and formula.name == "ago":
            return self.value(self.binder.delay(formula).slot, state)
        if isinstance(formula, Element):
            cells = self.binder.names.cells[formula.array, formula.rest]
            return self.element(formula, cells, [write(i, state) for i in formula.indices], state)
        return ""

    def value(self, index: int, state: str) -> str:
        """Write the value of a tag by its index."""
        return f"{state}[{index}]"

    def element(self, formula: Element, cells: Cells, indices: Sequence[str], state: str) -> str:
        """Write an element of an array at written indices."""
        name = f"cells{len(self.scope)}"
        self.scope[name] = cells
        return f"element({state}, {name}, {str(formula)!r}, {', '.join(indices)})"


def _element(values: Values, cells: Cells, text: str, *indices: Value | None) -> Value | None:
    """Return the value of an element of an array.

    Raises:
        LookupError: there is none at these indices.
    """
    if None in indices:
        return None
    where = tuple(int(index) for index in indices if index is not None)
    if where not in cells.at:
        raise LookupError(f"there is no element at [{', '.join(map(str, where))}], asked for by "
                          f"{text}")
    return values[cells.at[where]]


def values_of(refs: Sequence[int], tags: TagTable, values: Values) -> dict[str, Value | None]:
    """Return the values of tags by their full names."""
    return {tags[index].name: values[index] for index in refs}
