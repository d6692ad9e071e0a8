"""The grammar of formulas and statements: words in, trees out.

Precedence climbing over the table of operators. In EBNF:

    statement = pattern | formula ;                    (patterns: `plcemu.monitor.patterns`)
    formula   = prefix [ interval ] formula | formula infix [ interval ] formula | primary ;
    interval  = ( "[" | "(" ) duration "," ( duration | "inf" ) ( "]" | ")" ) ;
    primary   = "TRUE" | "FALSE" | "deadlock" | number | duration | "'" text "'" | tag
              | ( "A" | "E" ) "[" formula ( "U" | "W" | "R" ) [ interval ] formula "]"
              | tag "[" formula { "," formula } "]" [ "." name { "." name } ]
              | ( "rise" | "fall" | "changed" | "previous" ) "(" formula ")"
              | ( "abs" | "min" | "max" | "ago" ) "(" formula { "," formula } ")"
              | "(" formula ")" ;

An operator in letters stands for the tag of that name where no operand follows: in `H & X > 3`
both are tags.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from plcemu.base.spans import Diagnostic
from plcemu.base.time import DurationError, parse_duration_ns
from plcemu.monitor.codes import diagnostic
from plcemu.monitor.formula import (
    CALLS,
    CONSTANTS,
    FUNCTIONS,
    INFIX,
    OPERATORS,
    PREFIX,
    Binary,
    Call,
    Deadlock,
    Duration,
    Element,
    Formula,
    Group,
    Interval,
    Literal,
    Operator,
    TagRef,
    Unary,
)
from plcemu.monitor.lexer import Token
from plcemu.monitor.patterns import PATTERNS, Pattern, Slot, Stated, state

_OPEN, _CLOSE = {"[": True, "(": False}, {"]": True, ")": False}
_ENDS = (")", "]", ",", ":")


class Mistake(Exception):
    """Leaves the entry that is being read."""

    def __init__(self, finding: Diagnostic) -> None:
        super().__init__(str(finding))
        self.finding = finding


@dataclass(frozen=True, slots=True)
class Statement:
    """What stands after the colon: a formula, and the pattern that it was stated by, if any."""

    formula: Formula
    stated: Stated | None = None


class Parser:
    """Reads a list of words from left to right."""

    def __init__(self, tokens: list[Token]) -> None:
        self.tokens = tokens
        self.at = 0

    @property
    def here(self) -> Token:
        return self.tokens[self.at]

    def ahead(self, distance: int) -> Token:
        return self.tokens[min(self.at + distance, len(self.tokens) - 1)]

    def take(self) -> Token:
        token = self.here
        self.at = min(self.at + 1, len(self.tokens) - 1)
        return token

    def mistake(self, expected: str, hint: str = "") -> Mistake:
        return Mistake(diagnostic("M0001", self.here.span, found=str(self.here),
                                   expected=expected, hint=hint))

    def expect(self, what: str, expected: str = "") -> Token:
        """Take a word of this text or kind, or leave the entry."""
        if what not in (self.here.kind, self.here.text):
            raise self.mistake(expected or repr(what))
        return self.take()

    def statement(self) -> Statement:
        """Read a pattern in words, or else a formula."""
        begin, deepest, failure = self.at, -1, None
        for pattern in PATTERNS:
            try:
                if self.opens(pattern):
                    slots = self.slots(pattern)
                    if failure is not None and deepest > self.at:
                        break
                    span = self.tokens[begin].span.to(self.tokens[self.at - 1].span)
                    formula, stated = state(pattern, slots, span)
                    return Statement(formula, stated)
            except Mistake as mistake:
                if self.at > deepest:
                    deepest, failure = self.at, mistake
            self.at = begin
        if failure is not None:
            raise failure
        return Statement(self.formula())

    def opens(self, pattern: Pattern) -> bool:
        """Tell whether the words here begin a pattern; after its first slot, if that comes first.

        The position is then after these words, or after the first slot.
        """
        begin = self.at
        if isinstance(pattern.parts[0], Slot):
            try:
                self.formula()
            except Mistake:
                return False
        found = self.says(pattern.head)
        self.at = begin
        first = self.ahead(1)
        return found and not (isinstance(pattern.parts[0], str) and first.text in INFIX
                              and first.text not in PREFIX)

    def says(self, words: Sequence[str]) -> bool:
        """Tell whether these words come next."""
        return [self.ahead(n).text.casefold() for n in range(len(words))] == list(words)

    def slots(self, pattern: Pattern) -> dict[str, list[Formula]]:
        """Read all of a pattern; return what fills its slots."""
        found: dict[str, list[Formula]] = {}
        for n, part in enumerate(pattern.parts):
            if isinstance(part, Slot):
                follow = pattern.parts[n + 1] if n + 1 < len(pattern.parts) else ""
                found[part.name] = self.fill(part, str(follow))
            else:
                self.expect_word(part, f"{part!r}, as in {pattern.words!r}")
        return found

    def expect_word(self, word: str, expected: str) -> None:
        if self.here.text.casefold() != word:
            raise self.mistake(expected)
        self.take()

    def fill(self, slot: Slot, follow: str) -> list[Formula]:
        """Read what stands in a slot; a condition before `and` binds tighter than it."""
        if slot.kind == "duration":
            token = self.here
            if token.kind != "duration":
                raise self.mistake("a duration with its unit, such as 22s")
            self.take()
            return [Duration(self.duration_ns(token), token.span)]
        level = {"number": OPERATORS["+"].level, "condition": 0, "list": 0}[slot.kind]
        found = [self.formula(OPERATORS["U"].level if follow == "and" else level)]
        while slot.kind == "list" and self.here.text == ",":
            self.take()
            found.append(self.formula())
        if slot.kind == "list" and len(found) < 2:
            raise self.mistake("',' and the next of the list")
        return found

    def formula(self, level: int = 0) -> Formula:
        """Read a formula whose loosest operator binds at least as tightly as `level`."""
        left = self.operand()
        while row := self.infix(level):
            self.take()
            interval = self.interval(row)
            tighter = row.level + (row.group is not Group.RIGHT)
            right = self.formula(tighter)
            left = Binary(row.name, left, right, interval, left.span.to(right.span))
            again = self.infix(row.level)
            if row.group is Group.NONE and again and again.level == row.level:
                raise self.mistake("parentheses around one of the two",
                                   f"{row.name!r} and {again.name!r} do not chain")
        return left

    def infix(self, level: int) -> Operator | None:
        row = INFIX.get(self.here.text) if self.here.kind in ("symbol", "word") else None
        return row if row and row.level >= level else None

    def operand(self) -> Formula:
        token = self.here
        row = PREFIX.get(token.text) if token.kind in ("symbol", "word") else None
        if row is None or self.is_tag(token):
            return self.primary()
        self.take()
        interval = self.interval(row)
        arg = self.formula(row.level)
        return Unary(row.name, arg, interval, token.span.to(arg.span))

    def is_tag(self, token: Token) -> bool:
        """Tell whether an operator in letters stands for a tag: where no operand follows it."""
        after = self.ahead(1)
        closes = after.kind == "end" or after.text in _ENDS
        goes_on = after.text in INFIX and after.text not in PREFIX and after.kind != "name"
        return token.kind == "word" and token.text.isidentifier() and len(token.text) == 1 and (
            closes or goes_on)

    def primary(self) -> Formula:
        token = self.here
        calls = token.kind == "name" and self.ahead(1).text == "("
        if calls and token.text in CALLS:
            return self.call()
        if calls and token.text in FUNCTIONS:
            return self.function()
        if token.text == "(" and token.kind == "symbol":
            self.take()
            inner = self.formula()
            self.expect(")", "an operator or ')'")
            return inner
        leaf = self.leaf(token)
        if leaf is None:
            raise self.mistake("a tag, a number, a duration, TRUE, FALSE or '('",
                               f"a tag named {token.text} is written `{token.text}`"
                               if token.kind == "word" else "")
        self.take()
        bracketed = isinstance(leaf, TagRef) and self.here.text == "["
        return self.element(token) if bracketed else leaf

    def call(self) -> Formula:
        name = self.take()
        self.take()
        inner = self.formula()
        close = self.expect(")", "an operator or ')'")
        return Unary(CALLS[name.text].name, inner, None, name.span.to(close.span))

    def function(self) -> Formula:
        name = self.take()
        self.take()
        args = [self.formula()]
        fewest, most = FUNCTIONS[name.text]
        while self.here.text == "," and (most is None or len(args) < most):
            self.take()
            args.append(self.formula())
        if len(args) < fewest:
            raise self.mistake(f"',' and operand {len(args) + 1} of {name.text}")
        close = self.expect(")", "an operator or ')'")
        return Call(name.text, tuple(args), name.span.to(close.span))

    def element(self, name: Token) -> Formula:
        """Read what stands in brackets after a name: indices, or a path formula after A or E."""
        self.take()
        indices = [self.formula()]
        while self.here.text == ",":
            self.take()
            indices.append(self.formula())
        close = self.expect("]", "an operator, ',' or ']'")
        path = indices[0]
        if name.text in ("A", "E") and len(indices) == 1 and isinstance(path, Binary) \
                and path.op in ("U", "W", "R"):
            return Binary(name.text + path.op, path.left, path.right, path.interval,
                          name.span.to(close.span))
        rest = ""
        while self.here.text == "." and self.ahead(1).kind == "name":
            self.take()
            close = self.take()
            rest += "." + close.text
        array = name.text[1:-1] if name.kind == "quoted" else name.text
        return Element(array, tuple(indices), rest, name.span.to(close.span))

    def leaf(self, token: Token) -> Formula | None:
        if token.kind == "word" and token.text in CONSTANTS:
            return Literal(CONSTANTS[token.text], token.span)
        if token.text == "deadlock" and token.kind == "word":
            return Deadlock(token.span)
        if token.kind == "name" or (token.kind == "word" and self.is_tag(token)):
            return TagRef(token.text, token.span)
        if token.kind == "quoted":
            return TagRef(token.text[1:-1], token.span)
        if token.kind == "number":
            return Literal(number(token.text), token.span)
        if token.kind == "duration":
            return Duration(self.duration_ns(token), token.span)
        if token.kind == "text":
            return Literal(re.sub(r"\$(.)", r"\1", token.text[1:-1]), token.span)
        return None

    def duration_ns(self, token: Token) -> int:
        try:
            return parse_duration_ns(token.text)
        except DurationError:
            raise Mistake(diagnostic(
                "M0003", token.span, found=repr(token.text),
                hint="write a number and a unit, such as 10ms, 1.5s or T#1s500ms")) from None

    def interval(self, row: Operator) -> Interval | None:
        """Read the interval of a timed operator, if one stands here."""
        opening = self.here
        timed = (opening.text == "[" and opening.kind == "symbol") or (
            opening.text == "(" and self.ahead(2).text == ","
            and self.ahead(1).kind in ("duration", "number"))
        if not timed:
            return None
        if not row.timed:
            raise Mistake(diagnostic("M0005", opening.span, found=repr(row.name)))
        self.take()
        low = self.bound_ns()
        self.expect(",", "',' and the upper end of the interval")
        endless = self.here.text == "inf"
        high: int | None = None
        if endless:
            self.take()
        else:
            high = self.bound_ns()
        if self.here.text not in _CLOSE or (endless and self.here.text == "]"):
            raise self.mistake("')' after inf" if endless else "']' or ')'")
        closing = self.take()
        interval = Interval(low, high, _OPEN[opening.text], _CLOSE[closing.text])
        if interval.empty:
            raise Mistake(diagnostic("M0004", opening.span.to(closing.span), found=str(interval)))
        return interval

    def bound_ns(self) -> int:
        token = self.here
        unitless = token.kind == "number" and number(token.text) == 0
        if token.kind != "duration" and not unitless:
            hint = f"write {token.text}s for seconds" if token.kind == "number" else ""
            raise self.mistake("a duration with its unit, such as 22s", hint)
        self.take()
        return 0 if unitless else self.duration_ns(token)


def number(text: str) -> int | float:
    """Read a number: decimal, or with its base as in `16#FF`."""
    plain = text.replace("_", "")
    base, sign, digits = plain.partition("#")
    if sign:
        return int(digits, int(base))
    return int(plain) if plain.isdigit() else float(plain)
