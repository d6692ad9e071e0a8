"""Where the passes put what they find: diagnostics are collected, the first error stops no pass."""

from __future__ import annotations

from plcemu.base.errors import CompileError
from plcemu.base.spans import Diagnostic, Severity, Span
from plcemu.lang.codes import CODES

DIAGNOSTIC_LIMIT = 200
"""Errors, and warnings, kept in one compilation; the others are dropped."""


class Report:
    """The diagnostics of one compilation.

    Attributes:
        has_errors: whether an error was recorded.
    """

    def __init__(self) -> None:
        self._found: list[Diagnostic] = []
        self._kept = {True: 0, False: 0}
        self._seen: set[tuple[str, str, int]] = set()
        self.has_errors = False

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
        is_error = diagnostic.severity is Severity.ERROR
        self.has_errors = self.has_errors or is_error
        if self._kept[is_error] < DIAGNOSTIC_LIMIT:
            self._kept[is_error] += 1
            self._found.append(diagnostic)

    def sorted(self) -> list[Diagnostic]:
        """Return everything found, by file and place."""
        return sorted(self._found, key=lambda d: (d.span.source.name, d.span.start, d.code))

    def stop_on_errors(self) -> None:
        """Raise `CompileError` with everything found so far, if any of it is an error."""
        if self.has_errors:
            raise CompileError(self.sorted())
