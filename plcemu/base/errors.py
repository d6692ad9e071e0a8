"""Every error that is raised on purpose, a class for each way it ends (docs/architecture.md)."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence

from plcemu.base.spans import Diagnostic, Severity


class PlcemuError(Exception):
    """A mistake or a limit the user can act on; its text is shown without a traceback."""


class CompileError(PlcemuError):
    """The program text is wrong; `diagnostics` holds every mistake found, in order of place."""

    def __init__(self, diagnostics: Sequence[Diagnostic]) -> None:
        self.diagnostics = list(diagnostics)
        super().__init__("\n".join(str(d) for d in self.diagnostics))

    @property
    def errors(self) -> list[Diagnostic]:
        """The diagnostics that are errors, without the warnings."""
        return [d for d in self.diagnostics if d.severity is Severity.ERROR]

    @property
    def is_unreadable(self) -> bool:
        """Whether a file could not be read at all, which is wrong use rather than wrong text."""
        return any(d.code.endswith("0080") for d in self.diagnostics)


class ConfigError(PlcemuError):
    """The configuration is wrong: where (file, line, key path), what was found and expected."""

    def __init__(self, problems: Sequence[str]) -> None:
        self.problems = list(problems)
        super().__init__("\n".join(self.problems))


class ProgramFault(PlcemuError):
    """The running program did what its language does not define, such as dividing by zero.

    The resource goes to FAULT; the world can still read the process image.
    """

    def __init__(self, reason: str, *, task: str = "", pou: str = "", place: str = "",
                 t_ns: int = 0) -> None:
        self.reason, self.task, self.pou, self.place, self.t_ns = reason, task, pou, place, t_ns
        where = f" in {pou}" if pou else ""
        at = f" at {place}" if place else ""
        super().__init__(f"{reason}{where}{at} (task {task or '-'}, t = {t_ns / 1e9:.3f} s)")

    def __eq__(self, other: object) -> bool:
        """Whether both tell the same: an executed scan that is executed again faults equally."""
        return isinstance(other, ProgramFault) and self._said() == other._said()

    def __hash__(self) -> int:
        return hash(self._said())

    def _said(self) -> tuple[object, ...]:
        return self.reason, self.task, self.pou, self.place, self.t_ns


class LimitError(PlcemuError):
    """A stated limit was reached; the text names the limit and how to raise it."""


class UnknownNameError(PlcemuError, KeyError):
    """No tag, property or parameter of that name; the text offers the nearest ones."""

    def __init__(self, what: str, name: str, known: Iterable[str]) -> None:
        self.name = name
        self.message = f"there is no {what} {name!r}{did_you_mean(name, known)}"
        super().__init__(self.message)

    def __str__(self) -> str:
        return self.message


class TraceFormatError(PlcemuError):
    """A trace file cannot be read: which file and line, what was found, what was expected."""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return `; did you mean 'x'?` for the nearest known name, or an empty text."""
    by_fold = {k.casefold(): k for k in known}
    near = difflib.get_close_matches(name.casefold(), by_fold, n=1, cutoff=0.6)
    return f"; did you mean {by_fold[near[0]]!r}?" if near else ""
