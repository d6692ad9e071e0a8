"""Patterns: properties in a control engineer's words, each with its formula and its meaning.

One row of `PATTERNS` a pattern. The words are read as they stand; `{p}` is a slot for a
condition, `{x:number}` for a number, `{t:duration}` for a duration, `{p:list}` for several
conditions with commas. What is judged and proved is the formula; the meaning is what users are
shown beside it. The response, precedence and absence patterns are those of Dwyer, Avrunin and
Corbett, "Patterns in property specifications for finite-state verification", ICSE 1999.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import reduce
from itertools import combinations, pairwise
from typing import Any

from plcemu.base.spans import Span
from plcemu.monitor.formula import (
    NOWHERE,
    OPERATORS,
    TRUE,
    Binary,
    Call,
    Duration,
    Formula,
    Interval,
    Kind,
    Unary,
    children,
    rebuilt,
    walk,
)

Slots = Mapping[str, list[Formula]]
_PART = re.compile(r"\{(\w+)(?::(\w+))?\}|([\w]+|,)")


@dataclass(frozen=True, slots=True)
class Slot:
    """A place in a pattern; `kind` is `condition`, `number`, `duration` or `list`."""

    name: str
    kind: str = "condition"


@dataclass(frozen=True, slots=True)
class Stated:
    """A property as it was stated.

    Attributes:
        pattern: the pattern's words with its slots filled.
        meaning: what it demands, as a sentence.
    """

    pattern: str
    meaning: str


class Pattern:
    """One row of the table.

    Attributes:
        words: the text with slots in braces.
        parts: words and slots in order.
        head: the words by which it is recognised: those before or after its first slot.
        make: the formula, from what fills the slots.
        meaning: a sentence with the same slots.
    """

    def __init__(self, words: str, meaning: str, make: Callable[..., Formula]) -> None:
        self.words, self.meaning, self.make = words, meaning, make
        self.parts: list[str | Slot] = [
            Slot(m[1], m[2] or "condition") if m[1] else m[3] for m in _PART.finditer(words)]
        skipped = self.parts[1:] if isinstance(self.parts[0], Slot) else self.parts
        self.head: list[str] = []
        for part in skipped:
            if isinstance(part, Slot):
                break
            self.head.append(part)


def _always(p: Formula) -> Formula:
    return Unary("G", p)


def _not(p: Formula) -> Formula:
    return Unary("!", p)


def _implies(p: Formula, q: Formula) -> Formula:
    return Binary("->", p, q)


def _and(p: Formula, q: Formula) -> Formula:
    return Binary("&", p, q)


def _or(p: Formula, q: Formula) -> Formula:
    return Binary("|", p, q)


def _within(op: str, t: Duration, p: Formula, closed: bool = True) -> Formula:
    return Unary(op, p, Interval(0, t.ns, True, closed))


def occurs(p: Formula) -> Formula:
    """Return the instant at which a condition becomes true; a pulse is that already."""
    pulsed = any(isinstance(part, Unary) and OPERATORS[part.op].kind is Kind.PULSE
                 for part in walk(p))
    return p if pulsed else Unary("rise", p)


def _again(p: Formula, t: Duration) -> Formula:
    # Said of the past, it is violated at the same instant as G F[0,t] would be, and owes nothing
    # where a run is cut.
    return Unary("G", _within("O", t, occurs(p)), Interval(t.ns, None))


def _band(x: Formula, lo: Formula, hi: Formula) -> Formula:
    return _and(Binary(">=", x, lo), Binary("<=", x, hi))


def _rate(x: Formula, n: Formula, t: Duration) -> Formula:
    return _always(Binary("<=", Call("abs", (Binary("-", x, Call("ago", (x, t))),)), n))


def _at_most_one(*p: Formula) -> Formula:
    return _always(reduce(_and, (_not(_and(a, b)) for a, b in combinations(p, 2))))


def _sequence(*p: Formula) -> Formula:
    start = _not(Unary("Y", TRUE))
    events = [_or(occurs(each), _and(each, start)) for each in p]
    some = reduce(_or, events)

    def last_was(event: Formula) -> Formula:
        return Unary("Y", Binary("S", _not(some), event))

    begins = _not(Unary("Y", Unary("O", some)))
    first = _implies(events[0], _or(begins, last_was(events[-1])))
    return _always(reduce(_and, [first, *(_implies(after, last_was(before))
                                          for before, after in pairwise(events))]))


PATTERNS: tuple[Pattern, ...] = (
    Pattern("never both {p} and {q}", "{p} and {q} are never true at the same time.",
            lambda p, q: _always(_not(_and(p, q)))),
    Pattern("at most one of {p:list}", "No two of {p} are true at the same time.", _at_most_one),
    Pattern("never {p}", "{p} is never true.", lambda p: _always(_not(p))),
    Pattern("always {p}", "{p} is true at every instant.", _always),
    Pattern("after {p} until {q} never {r}",
            "Once {p} is true, {r} is not true until {q} is; {q} need not come.",
            lambda p, q, r: _always(_implies(_and(p, _not(q)), Binary("W", _not(r), q)))),
    Pattern("after {p} never {r}", "Once {p} has been true, {r} is never true again.",
            lambda p, r: _always(_implies(p, _always(_not(r))))),
    Pattern("sequence {p:list}",
            "{p} become true in this order, over and over: each only after the one before it.",
            _sequence),
    Pattern("{p} only while {q}", "{p} is true only while {q} is true.",
            lambda p, q: _always(_implies(p, q))),
    Pattern("{p} causes {q} within {t:duration}",
            "Whenever {p} is true, {q} is true at some instant from then to {t} later.",
            lambda p, q, t: _always(_implies(p, _within("F", t, q)))),
    Pattern("{p} causes {q}", "Whenever {p} is true, {q} is true then or some time later.",
            lambda p, q: _always(_implies(p, Unary("F", q)))),
    Pattern("{p} not before {q}", "{p} is not true before {q} has been true for the first time.",
            lambda p, q: Binary("W", _not(p), q)),
    Pattern("{p} lasts at least {t:duration}",
            "Whenever {p} becomes true, it stays true for at least {t}.",
            lambda p, t: _always(_implies(Unary("rise", p), _within("G", t, p, closed=False)))),
    Pattern("{p} lasts at most {t:duration}", "{p} does not stay true for longer than {t}.",
            lambda p, t: _always(_implies(p, _within("F", t, _not(p))))),
    Pattern("{p} again every {t:duration}",
            "{p} becomes true at least once in every stretch of {t}, from the start on.", _again),
    Pattern("{x:number} stays within {lo:number} to {hi:number} except during {p}",
            "{x} is at least {lo} and at most {hi}, except while {p} is true.",
            lambda x, lo, hi, p: _always(_or(p, _band(x, lo, hi)))),
    Pattern("{x:number} stays within {lo:number} to {hi:number}",
            "{x} is at least {lo} and at most {hi}.",
            lambda x, lo, hi: _always(_band(x, lo, hi))),
    Pattern("{x:number} changes at most {n:number} per {t:duration}",
            "{x} differs by at most {n} from what it was {t} before; before the start it was what "
            "it was at the start.", _rate),
)
"""Of two patterns that begin alike the longer one comes first."""


def state(pattern: Pattern, slots: Slots, span: Span) -> tuple[Formula, Stated]:
    """Return the formula of a pattern whose slots are filled, and how it was stated.

    Places of its own making get the place of the whole statement.
    """
    operands: list[Any] = [each for part in pattern.parts if isinstance(part, Slot)
                           for each in slots[part.name]]
    shown = {name: ", ".join(str(each) for each in found) for name, found in slots.items()}
    words = _PART.sub(lambda m: shown[m[1]] if m[1] else m[3], pattern.words)
    meaning = _PART.sub(lambda m: shown[m[1]] if m[1] else m[0], pattern.meaning)
    return _placed(pattern.make(*operands), span), Stated(words, meaning)


def _placed(formula: Formula, span: Span) -> Formula:
    if formula.span is not NOWHERE:
        return formula
    placed = rebuilt(formula, [_placed(part, span) for part in children(formula)])
    return replace(placed, span=span)
