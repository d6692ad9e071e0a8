"""Where the passes put what they find: diagnostics are collected, the first error stops no pass."""

from __future__ import annotations

from plcemu.base.errors import CompileError
from plcemu.base.spans import Diagnostic, Severity, Span
from plcemu.lang.codes import CODES

DIAGNOSTIC_LIMIT = 200
"""Findings kept in one compilation; the rest is counted only."""


class Report:
    """The diagnostics of one compilation."""

    def __init__(self) -> None:
        self._found: list[Diagnostic] = []
        self._seen: set[tuple[str, str, int]] = set()
        self.dropped = 0

    def error(self, code: str, span: Span, message: str, hint: str = "") -> None:
        """Record a mistake; the same code at the same place counts once."""
        self._add(Diagnostic(code, span, message, hint))

    def warning(self, code: str, span: Span, message: str, hint: str = "") -> None:
        """Record something that is likely a mistake but compiles."""
        self._add(Diagnostic(code, span, message, hint, Severity.WARNING))

    def _add(self, diagnostic: Diagnostic) -> None:
        assert diagnostic.code in CODES, diagnostic.code
        key = (diagnostic.code, diagnostic.span.source.name, diagnostic.span.start)
        if key in self._seen:
            return
        self._seen.add(key)
        if len(self._found) >= DIAGNOSTIC_LIMIT:
            self.dropped += 1
            return
        self._found.append(diagnostic)

    @property
    def has_errors(self) -> bool:
        """Whether an error was recorded."""
        return any(d.severity is Severity.ERROR for d in self._found)

    def sorted(self) -> list[Diagnostic]:
        """Return everything found, by file and place."""
        return sorted(self._found, key=lambda d: (d.span.source.name, d.span.start, d.code))

    def stop_on_errors(self) -> None:
        """Raise `CompileError` with everything found so far, if any of it is an error."""
        if self.has_errors:
            raise CompileError(self.sorted())
