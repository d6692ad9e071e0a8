"""A cursor over tokens: what every parser of the front end reads through."""

from __future__ import annotations

import difflib
from collections.abc import Collection
from dataclasses import replace

from plcemu.base.spans import Span
from plcemu.lang.lexer import Token
from plcemu.lang.report import Report

NESTING_LIMIT = 60
"""How deeply expressions, statements and IL parentheses may nest."""

RESERVED = frozenset((
    "PROGRAM", "END_PROGRAM", "FUNCTION_BLOCK", "END_FUNCTION_BLOCK", "FUNCTION", "END_FUNCTION",
    "CONFIGURATION", "END_CONFIGURATION", "TYPE", "END_TYPE", "VAR", "VAR_INPUT", "VAR_OUTPUT",
    "VAR_IN_OUT", "VAR_TEMP", "VAR_GLOBAL", "VAR_EXTERNAL", "END_VAR", "INITIAL_STEP", "STEP",
    "END_STEP", "TRANSITION", "END_TRANSITION", "ACTION", "END_ACTION", "IF", "THEN", "ELSIF",
    "ELSE", "END_IF", "END_PLACE", "CASE", "OF", "END_CASE", "FOR", "TO", "BY", "DO", "END_FOR",
    "WHILE", "END_WHILE", "REPEAT", "UNTIL", "END_REPEAT", "EXIT", "RETURN"))
"""Keywords that can be no name and at which recovery stops."""


_CLOSERS = sorted(word for word in RESERVED if word.startswith("END_"))


class SyntaxFailure(Exception):
    """The parser cannot go on here; the report says why, the caller finds a place to resume."""


class NestedTooDeeply(SyntaxFailure):
    """What begins here is to be skipped with all that it holds."""


class Cursor:
    """The tokens of one source and a place among them.

    Attributes:
        token: the token at the cursor; at the end the `end` token for ever.
        word: the keyword, name or sign at the cursor in capitals; empty at a literal.
        functions: the names, in capitals, of the user's functions, which are operators in IL.
    """

    def __init__(self, tokens: list[Token], report: Report,
                 functions: Collection[str] = ()) -> None:
        self._tokens = tokens
        self.functions = functions
        self._index = 0
        self.report = report
        self._depth = 0
        self._look()

    def _look(self) -> None:
        self.token = token = self._tokens[self._index]
        self.word = token.text.upper() if token.kind in ("name", "op") else ""

    def peek(self, ahead: int = 1) -> Token:
        """Return a token further on."""
        return self._tokens[min(self._index + ahead, len(self._tokens) - 1)]

    @property
    def index(self) -> int:
        """The number of the token at the cursor."""
        return self._index

    def since(self, index: int) -> list[Token]:
        """Return the tokens from a number up to the cursor, without the one at it."""
        return self._tokens[index:self._index]

    @property
    def previous(self) -> Token:
        """The token before the cursor."""
        return self._tokens[max(self._index - 1, 0)]

    def advance(self) -> Token:
        """Return the token at the cursor and step over it."""
        token = self.token
        if token.kind != "end":
            self._index += 1
            self._look()
        return token

    def at(self, *texts: str) -> bool:
        """Whether the token is one of these keywords or signs."""
        return self.word in texts

    def at_end(self) -> bool:
        """Whether no token is left."""
        return self.token.kind == "end"

    def accept(self, *texts: str) -> Token | None:
        """Step over the token if it is one of these."""
        return self.advance() if self.word in texts else None

    def mend_closer(self) -> None:
        """Take a misspelt `END_...` for the keyword that is meant; the mistake is reported."""
        token = self.token
        if self.word[:3] != "END" or self.word in RESERVED \
                or self.peek().text in (":=", "(", ".", ":", ","):
            return
        near = difflib.get_close_matches(token.upper, _CLOSERS, n=1, cutoff=0.8)
        if near:
            self.report.error("P0010", token.span, f"{token.text!r} closes nothing",
                              f"did you mean {near[0]!r}?")
            self._tokens[self._index] = replace(token, text=near[0])
            self._look()

    def expect(self, text: str, context: str = "", code: str = "P0010") -> Token:
        """Step over the token, which must be this one."""
        if text in _CLOSERS:
            self.mend_closer()
        if self.at(text):
            return self.advance()
        raise self.failure(f"{text!r}" + (f" {context}" if context else ""), code)

    def identifier(self, what: str) -> Token:
        """Step over a name that is no keyword."""
        if self.token.kind == "name" and self.token.upper not in RESERVED:
            return self.advance()
        raise self.failure(what)

    def failure(self, expected: str, code: str = "P0010") -> SyntaxFailure:
        """Report that something else was expected here, and return the exception to raise.

        Of a text that is no token the lexer has told already.
        """
        if self.token.kind == "bad" or (self.at_end() and self.previous.kind == "bad"):
            return SyntaxFailure()
        found = "the end of the text" if self.at_end() else repr(self.token.text)
        self.report.error(code, self.place(), f"expected {expected}, found {found}")
        return SyntaxFailure()

    def place(self) -> Span:
        """Return where the token stands; at the end of the text, the end of the last token."""
        if self.at_end() and self._index:
            last = self.previous.span
            return Span(last.source, last.end, last.end)
        return self.token.span

    def skip_to(self, *texts: str, over: Collection[str] = ()) -> None:
        """Skip to one of these tokens (or the end), and over it if it is among `over`."""
        while not self.at_end() and not self.at(*texts):
            self.advance()
        if self.at(*over):
            self.advance()

    def enter(self) -> None:
        """Count one level of nesting.

        Raises:
            NestedTooDeeply: `NESTING_LIMIT` levels are open.
        """
        if self._depth >= NESTING_LIMIT:
            raise self.too_deep()
        self._depth += 1

    def too_deep(self) -> NestedTooDeeply:
        """Report that too many levels are open here, and return the exception to raise."""
        self.report.error("P0014", self.place(), f"nested more than {NESTING_LIMIT} levels deep")
        return NestedTooDeeply()

    def leave(self) -> None:
        """End one level of nesting."""
        self._depth -= 1
