"""The words of the property language."""

from __future__ import annotations

import re
from dataclasses import dataclass

from plcemu.base.spans import Diagnostic, Source, Span
from plcemu.monitor.codes import diagnostic
from plcemu.monitor.formula import CONSTANTS, INFIX, PREFIX

_AMOUNT = r"\d[\d_]*(?:\.\d+)?(?:ms|us|µs|ns|min|d|h|m|s)"
_SYMBOLS = sorted({s for s in (*INFIX, *PREFIX) if not s[0].isalpha()} | set("()[],:."),
                  key=len, reverse=True)
_PATTERNS = (
    ("space", r"\s+|//[^\n]*|/\*.*?\*/"),
    ("branch", r"[AE](?:\[\s*\]|<>|□|◇)"),
    ("duration", rf"(?i:l?time|lt|t)#-?[\w.]+|{_AMOUNT}(?:_?{_AMOUNT})*\b"),
    ("based", r"(?:16#[\da-fA-F_]+|8#[0-7_]+|2#[01_]+)\b"),
    ("number", r"\d[\d_]*(?:\.\d+(?:[eE][+-]?\d+)?|[eE][+-]?\d+)?(?!\w)"),
    ("name", r"[^\W\d]\w*(?:#[^\W\d]\w*|(?:\.\w+)*)|%[A-Za-z]+\d+(?:\.\d+)*"),
    ("quoted", r"`[^`\n]+`"),
    ("text", r"'(?:\$.|[^'$\n])*'"),
    ("remark", r'"[^"\n]*"'),
    ("symbol", "|".join(re.escape(s) for s in _SYMBOLS)),
)
_TOKEN = re.compile("|".join(f"(?P<{kind}>{pattern})" for kind, pattern in _PATTERNS), re.DOTALL)
_INDEX = re.compile(r"\[ *-?\d+ *(?:, *-?\d+ *)*\](?:\.\w+)*")

_WORDS = frozenset({*INFIX, *PREFIX, *CONSTANTS, "deadlock"} - {"negate"})


@dataclass(frozen=True, slots=True)
class Token:
    """One word; `kind` is that of its pattern, or `word` (operators in letters), or `end`."""

    kind: str
    text: str
    span: Span

    def __str__(self) -> str:
        return "the end of the text" if self.kind == "end" else repr(self.text)


def tokenize(source: Source, diagnostics: list[Diagnostic]) -> list[Token]:
    """Split a text into words; characters that are none are reported and skipped."""
    tokens: list[Token] = []
    position, length = 0, len(source.text)
    while position < length:
        match = _TOKEN.match(source.text, position)
        end = match.end() if match else position + 1
        kind = match.lastgroup if match else None
        if kind == "name" and source.text[position:end] not in _WORDS:
            while index := _INDEX.match(source.text, end):
                end = index.end()
        span = Span(source, position, end)
        word = source.text[position:end]
        if kind in ("branch", "name"):
            word = word.replace(" ", "")
        if kind is None:
            diagnostics.append(diagnostic("M0002", span, found=repr(word)))
        elif kind != "space":
            tokens.append(Token(_kind(kind, word), word, span))
        position = end
    tokens.append(Token("end", "", Span(source, length, length)))
    return tokens


def _kind(kind: str, word: str) -> str:
    """Tell operators, written as words or as symbols, from names."""
    if kind == "branch" or (kind == "name" and word in _WORDS):
        return "word"
    return "number" if kind == "based" else kind
