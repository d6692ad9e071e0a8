"""Places in a source text, and what is said about them."""

from __future__ import annotations

import enum
from bisect import bisect_right
from dataclasses import dataclass, field
from typing import NamedTuple


@dataclass(frozen=True, slots=True)
class Source:
    """One source text with its name (a path, or `<text>`)."""

    name: str
    text: str
    _starts: list[int] = field(default_factory=list, repr=False, compare=False, hash=False)

    def position(self, offset: int) -> tuple[int, int]:
        """Return line and column, both from 1, of a character offset."""
        if not self._starts:
            self._starts.append(0)
            self._starts.extend(i + 1 for i, c in enumerate(self.text) if c == "\n")
        line = bisect_right(self._starts, offset)
        return line, offset - self._starts[line - 1] + 1


class Span(NamedTuple):
    """A stretch of a source text, as character offsets [start, end)."""

    source: Source
    start: int
    end: int

    def to(self, other: Span) -> Span:
        """Return the span from the start of this one to the end of the other."""
        return Span(self.source, self.start, max(self.end, other.end))

    def __str__(self) -> str:
        line, column = self.source.position(self.start)
        return f"{self.source.name}:{line}:{column}"

    def __repr__(self) -> str:
        return f"Span({self})"


class Severity(enum.Enum):
    """How bad a diagnostic is; only errors stop a compilation."""

    ERROR = "error"
    WARNING = "warning"


@dataclass(frozen=True, slots=True)
class Diagnostic:
    """One finding about a program text.

    Attributes:
        code: the stable code, listed in `plcemu.lang.codes`.
        span: where.
        message: what was found and what was expected.
        hint: a likely fix, or empty.
        severity: error or warning.
    """

    code: str
    span: Span
    message: str
    hint: str = ""
    severity: Severity = Severity.ERROR

    def __str__(self) -> str:
        kind = "warning: " if self.severity is Severity.WARNING else ""
        hint = f" ({self.hint})" if self.hint else ""
        return f"{self.span}: {self.code} {kind}{self.message}{hint}"

    def as_json(self) -> dict[str, object]:
        """Return the finding as plain values: file, line, column, code, severity, message, hint."""
        line, column = self.span.source.position(self.span.start)
        return {"file": self.span.source.name, "line": line, "column": column, "code": self.code,
                "severity": self.severity.value, "message": self.message, "hint": self.hint}
