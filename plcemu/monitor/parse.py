"""Read formulas and `.prop` files.

    file  = { entry } ;
    entry = name [ '"' description '"' ] [ severity ] ":" statement ;

What a statement is says `plcemu.monitor.grammar`. A mistake ends its entry; reading goes on at the
next one, so that one run finds several.
"""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from plcemu.base.errors import CompileError
from plcemu.base.spans import Diagnostic, Source, Span
from plcemu.monitor.codes import diagnostic
from plcemu.monitor.formula import Formula
from plcemu.monitor.grammar import Mistake, Parser, Statement
from plcemu.monitor.lexer import Token, tokenize
from plcemu.monitor.patterns import Stated


class Severity(enum.StrEnum):
    """How bad it is if a property is violated; only errors and worse fail a run."""

    INFO = "info"
    WARNING = "warning"
    ERROR = "error"
    CRITICAL = "critical"

    @property
    def fails(self) -> bool:
        """Whether a violation makes a run fail."""
        return self in (Severity.ERROR, Severity.CRITICAL)


@dataclass(frozen=True, slots=True)
class Property:
    """One entry of a `.prop` file.

    Attributes:
        name: unique in its file.
        formula: what is demanded; a pattern is expanded.
        description: in the user's words; may be empty.
        span: the place of the name.
        severity: how bad a violation is.
        stated: the pattern that it was stated by; None for a formula.
    """

    name: str
    formula: Formula
    description: str = ""
    span: Span | None = None
    severity: Severity = Severity.ERROR
    stated: Stated | None = None


def parse_formula(text: str | Source) -> Formula:
    """Read one formula, or a pattern, which is expanded.

    Raises:
        CompileError: the text is neither.
    """
    return parse_property(text).formula


def parse_property(text: str | Source, name: str = "property") -> Property:
    """Read one formula or pattern as a property of a given name.

    Raises:
        CompileError: the text is neither.
    """
    diagnostics: list[Diagnostic] = []
    parser = Parser(tokenize(_source(text, "<formula>"), diagnostics))
    statement: Statement | None = None
    try:
        statement = parser.statement()
        parser.expect("end", "an operator or the end of the formula")
    except Mistake as mistake:
        diagnostics.append(mistake.finding)
    if diagnostics or statement is None:
        raise CompileError(_in_order(diagnostics))
    return Property(name, statement.formula, stated=statement.stated)


def parse_properties(text: str | Source) -> list[Property]:
    """Read the entries of a `.prop` file.

    Raises:
        CompileError: with every mistake found.
    """
    diagnostics: list[Diagnostic] = []
    parser = _FileParser(tokenize(_source(text, "<properties>"), diagnostics))
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
        except Mistake as mistake:
            diagnostics.append(mistake.finding)
            parser.skip_to_entry()
    if diagnostics:
        raise CompileError(_in_order(diagnostics))
    return entries


def load_properties(path: str | Path) -> list[Property]:
    """Read a `.prop` file.

    Raises:
        CompileError: with every mistake found, or it is no UTF-8 text.
        OSError: the file cannot be read.
    """
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as problem:
        before = Source(str(path), problem.object[:problem.start].decode("utf-8-sig"))
        end = Span(before, len(before.text), len(before.text))
        raise CompileError([diagnostic("M0007", end, found="it is not UTF-8 text from here on")]
                           ) from None
    return parse_properties(Source(str(path), text))


def _source(text: str | Source, name: str) -> Source:
    return text if isinstance(text, Source) else Source(name, text)


def _in_order(diagnostics: Sequence[Diagnostic]) -> list[Diagnostic]:
    return sorted(diagnostics, key=lambda d: d.span.start)


class _FileParser(Parser):
    """Reads the entries of a file."""

    def entry(self, name: Token) -> Property:
        """Read what follows the name."""
        remark = self.take().text[1:-1] if self.here.kind == "remark" else ""
        severity = self.severity()
        self.expect(":", "':' and a formula" if remark else "a description in \" or ':'")
        statement = self.statement()
        if not self.at_entry() and self.here.kind != "end":
            raise self.mistake("an operator, the next property or the end of the file")
        return Property(name.text, statement.formula, remark, name.span, severity,
                        statement.stated)

    def severity(self) -> Severity:
        """Read a severity, if one stands before the colon."""
        if self.here.kind != "name" or self.ahead(1).text != ":":
            return Severity.ERROR
        if self.here.text.casefold() not in list(Severity):
            raise self.mistake(f"a severity ({', '.join(Severity)}) or ':'")
        return Severity(self.take().text.casefold())

    def at_entry(self) -> bool:
        colon = 2 if self.ahead(1).kind == "remark" else 1
        severity = self.ahead(colon).text.casefold() in list(Severity)
        return self.here.kind == "name" and self.ahead(colon + severity).text == ":"

    def skip_to_entry(self) -> None:
        while self.here.kind != "end" and not self.at_entry():
            self.take()
