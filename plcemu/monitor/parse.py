"""Read formulas and `.prop` files.

Precedence climbing over the table of operators. Grammar of a file, in EBNF:

    file     = { entry } ;
    entry    = name [ '"' description '"' ] ":" formula ;
    formula  = prefix [ interval ] formula | formula infix [ interval ] formula | primary ;
    interval = ( "[" | "(" ) duration "," ( duration | "inf" ) ( "]" | ")" ) ;
    primary  = "TRUE" | "FALSE" | number | duration | "'" text "'" | tag
             | ( "rise" | "fall" | "changed" ) "(" formula ")" | "(" formula ")" ;

A mistake ends its entry; reading goes on at the next one, so that one run finds several.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from plcemu.base.errors import CompileError
from plcemu.base.spans import Diagnostic, Source, Span
from plcemu.base.time import DurationError, parse_duration_ns
from plcemu.monitor.codes import diagnostic
from plcemu.monitor.formula import (
    CALLS,
    INFIX,
    PREFIX,
    Binary,
    Duration,
    Formula,
    Group,
    Interval,
    Literal,
    Operator,
    TagRef,
    Unary,
)
from plcemu.monitor.lexer import Token, tokenize

_TRUTH = {"TRUE": True, "true": True, "FALSE": False, "false": False}
_OPEN, _CLOSE = {"[": True, "(": False}, {"]": True, ")": False}


@dataclass(frozen=True, slots=True)
class Property:
    """One entry of a `.prop` file.

    Attributes:
        name: unique in its file.
        formula: what is demanded.
        description: in the user's words; may be empty.
        span: the place of the name.
    """

    name: str
    formula: Formula
    description: str = ""
    span: Span | None = None


class _Mistake(Exception):
    """Leaves the entry that is being read."""

    def __init__(self, finding: Diagnostic) -> None:
        super().__init__(str(finding))
        self.finding = finding


def parse_formula(text: str | Source) -> Formula:
    """Read one formula.

    Raises:
        CompileError: the text is no formula.
    """
    diagnostics: list[Diagnostic] = []
    parser = _Parser(tokenize(_source(text, "<formula>"), diagnostics))
    formula: Formula | None = None
    try:
        formula = parser.formula()
        parser.expect("end", "an operator or the end of the formula")
    except _Mistake as mistake:
        diagnostics.append(mistake.finding)
    if diagnostics or formula is None:
        raise CompileError(_in_order(diagnostics))
    return formula


def parse_properties(text: str | Source) -> list[Property]:
    """Read the entries of a `.prop` file.

    Raises:
        CompileError: with every mistake found.
    """
    diagnostics: list[Diagnostic] = []
    parser = _Parser(tokenize(_source(text, "<properties>"), diagnostics))
    names: dict[str, Span] = {}
    entries: list[Property] = []
    while parser.here.kind != "end":
        try:
            name = parser.expect("name", "the name of a property")
            first = names.setdefault(name.text.casefold(), name.span)
            if first is not name.span:
                diagnostics.append(diagnostic("M0006", name.span, found=repr(name.text),
                                              hint=f"the first stands at {first}"))
            entries.append(parser.entry(name))
        except _Mistake as mistake:
            diagnostics.append(mistake.finding)
            parser.skip_to_entry()
    if diagnostics:
        raise CompileError(_in_order(diagnostics))
    return entries


def load_properties(path: str | Path) -> list[Property]:
    """Read a `.prop` file.

    Raises:
        CompileError: with every mistake found.
        OSError: the file cannot be read.
    """
    return parse_properties(Source(str(path), Path(path).read_text(encoding="utf-8")))


def _source(text: str | Source, name: str) -> Source:
    return text if isinstance(text, Source) else Source(name, text)


def _in_order(diagnostics: Sequence[Diagnostic]) -> list[Diagnostic]:
    return sorted(diagnostics, key=lambda d: d.span.start)


class _Parser:
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

    def mistake(self, expected: str, hint: str = "") -> _Mistake:
        return _Mistake(diagnostic("M0001", self.here.span, found=str(self.here),
                                   expected=expected, hint=hint))

    def expect(self, what: str, expected: str = "") -> Token:
        """Take a word of this text or kind, or leave the entry."""
        if what not in (self.here.kind, self.here.text):
            raise self.mistake(expected or repr(what))
        return self.take()

    def entry(self, name: Token) -> Property:
        """Read what follows the name in `name "description": formula`."""
        remark = self.take().text[1:-1] if self.here.kind == "remark" else ""
        self.expect(":", "':' and a formula" if remark else "a description in \" or ':'")
        formula = self.formula()
        if not self.at_entry() and self.here.kind != "end":
            raise self.mistake("an operator, the next property or the end of the file")
        return Property(name.text, formula, remark, name.span)

    def at_entry(self) -> bool:
        colon = 2 if self.ahead(1).kind == "remark" else 1
        return self.here.kind == "name" and self.ahead(colon).text == ":"

    def skip_to_entry(self) -> None:
        while self.here.kind != "end" and not self.at_entry():
            self.take()

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
        if row is None:
            return self.primary()
        self.take()
        interval = self.interval(row)
        arg = self.formula(row.level)
        return Unary(row.name, arg, interval, token.span.to(arg.span))

    def primary(self) -> Formula:
        token = self.here
        if token.text in CALLS and token.kind == "name":
            return self.call()
        if token.text == "(":
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
        return leaf

    def call(self) -> Formula:
        name = self.take()
        self.expect("(", f"'(' after {name.text}")
        inner = self.formula()
        close = self.expect(")", "an operator or ')'")
        return Unary(CALLS[name.text].name, inner, None, name.span.to(close.span))

    def leaf(self, token: Token) -> Formula | None:
        if token.text in _TRUTH and token.kind == "word":
            return Literal(_TRUTH[token.text], token.span)
        if token.kind == "name":
            return TagRef(token.text, token.span)
        if token.kind == "quoted":
            return TagRef(token.text[1:-1], token.span)
        if token.kind == "number":
            return Literal(_number(token.text), token.span)
        if token.kind == "duration":
            return Duration(self.duration_ns(token), token.span)
        if token.kind == "text":
            return Literal(re.sub(r"\$(.)", r"\1", token.text[1:-1]), token.span)
        return None

    def duration_ns(self, token: Token) -> int:
        try:
            return parse_duration_ns(token.text)
        except DurationError:
            raise _Mistake(diagnostic(
                "M0003", token.span, found=repr(token.text),
                hint="write a number and a unit, such as 10ms, 1.5s or T#1s500ms")) from None

    def interval(self, row: Operator) -> Interval | None:
        """Read the interval of a timed operator, if one stands here."""
        opening = self.here
        timed = opening.text == "[" or (
            opening.text == "(" and self.ahead(2).text == ","
            and self.ahead(1).kind in ("duration", "number"))
        if not timed:
            return None
        if not row.timed:
            raise _Mistake(diagnostic("M0005", opening.span, found=repr(row.name)))
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
            raise _Mistake(diagnostic("M0004", opening.span.to(closing.span), found=str(interval)))
        return interval

    def bound_ns(self) -> int:
        token = self.here
        unitless = token.kind == "number" and _number(token.text) == 0
        if token.kind != "duration" and not unitless:
            hint = f"write {token.text}s for seconds" if token.kind == "number" else ""
            raise self.mistake("a duration with its unit, such as 22s", hint)
        self.take()
        return 0 if unitless else self.duration_ns(token)


def _number(text: str) -> int | float:
    plain = text.replace("_", "")
    return int(plain) if plain.isdigit() else float(plain)
