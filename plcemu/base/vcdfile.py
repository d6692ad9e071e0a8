"""Traces as value change dumps (IEEE 1800-2017, clause 21.7) by pyvcd: 1 ns, a scope for each dot.

BOOL is a wire, signed whole numbers, times and dates are 64-bit integers in two's complement,
unsigned ones and bit strings are registers of their width, floats are reals, and texts are the
strings that GTKWave knows. Only these classes read back: BOOL, LINT, ULINT, LREAL and STRING.
Instants of finer timescales are rounded down to whole ns; of what changes within one, the last
value counts. A value that is not known is `x`; of a real it is NaN and of a text it is empty, and
so they read back.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any, TextIO

from vcd.common import Timescale
from vcd.reader import Token, TokenKind, VarDecl, VCDParseError, tokenize
from vcd.writer import VCDWriter

from plcemu.base.errors import TraceFormatError
from plcemu.base.tags import Tag, TagTable
from plcemu.base.trace import Change, Frame, Trace
from plcemu.base.types import ELEMENTARY, Value

_TOP = "$root"
"""The scope of tags without a dot; the format knows no variable outside a scope."""

_SECONDS = {"s": 0, "ms": -3, "us": -6, "ns": -9, "ps": -12, "fs": -15, "as": -18, "zs": -21}
_ESCAPED = re.compile(r"\\(x[0-9a-fA-F]{2}|u[0-9a-fA-F]{4}|U[0-9a-fA-F]{8}|.)")
_ESCAPES = {"t": "\t", "n": "\n", "r": "\r"}


class _Exact(float):
    """A float that is written with all its digits: 16 of them would lose the last bit."""

    def __format__(self, spec: str) -> str:
        return repr(float(self))


class _Ascii(str):
    """A text that is written in ASCII, since the format is: other characters as escapes."""

    __slots__ = ()

    def translate(self, table: Any, /) -> str:
        return "".join(c if c.isascii() else c.encode("unicode_escape").decode("ascii")
                       for c in super().translate(table))


def write(trace: Trace, file: TextIO) -> None:
    """Write a trace as a value change dump, without a date.

    Raises:
        TraceFormatError: a value does not fit its tag's type.
    """
    frames = trace.frames
    first = dict(frames[0].changes) if frames else {}
    start_ns = frames[0].t_ns if frames else 0
    with VCDWriter(file, timescale="1 ns", date="", init_timestamp=start_ns) as writer:
        try:
            variables = [_register(writer, tag, first.get(i)) for i, tag in enumerate(trace.tags)]
            for frame in frames[1:]:
                for index, value in frame.changes:
                    writer.change(variables[index], frame.t_ns,
                                  _unknown(trace.tags[index]) if value is None
                                  else _written(value))
        except ValueError as error:
            raise TraceFormatError(f"the trace does not fit a .vcd file: {error}") from None
        writer.close(max(trace.end_ns, start_ns))


def _unknown(tag: Tag) -> Value:
    """Return what is written for a value that is not known."""
    row = ELEMENTARY.get(tag.type)
    return "" if row is None else _Exact("nan") if row.kind == "float" else "x"


def _written(value: Value | None) -> Value | None:
    if isinstance(value, str):
        return _Ascii(value)
    return _Exact(value) if isinstance(value, float) else value


def _register(writer: VCDWriter, tag: Tag, value: Value | None) -> Any:
    *scope, name = tag.name.split(".")
    row = ELEMENTARY.get(tag.type)
    kinds = {"bool": ("wire", 1), "int": ("integer", 64), "time": ("integer", 64),
             **dict.fromkeys(("date", "tod", "dt"), ("integer", 64)),
             "float": ("real", 64), "uint": ("reg", row.bits if row else 64),
             "bits": ("reg", row.bits if row else 64)}
    var_type, size = kinds[row.kind] if row else ("string", 1)
    return writer.register_var(tuple(scope) or (_TOP,), name, var_type, size, _written(value))


def read(path: Path) -> Trace:
    """Read a value change dump.

    Raises:
        TraceFormatError: the file is malformed.
    """
    reader = _Reader(path)
    with path.open("rb") as file:
        try:
            for token in tokenize(file):
                reader.take(token)
        except (VCDParseError, ValueError) as error:
            line = error.loc.line if isinstance(error, VCDParseError) else reader.line
            raise reader.wrong(line, str(error), "a value change dump") from None
    return reader.finish()


class _Reader:
    """Gathers the words of a value change dump into a trace."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.line = 1
        self.scopes: list[str] = []
        self.scale_ns = Fraction(1)
        self.tags: list[Tag] = []
        self.indices: dict[str, list[int]] = {}
        self.convert: dict[str, Callable[[Any], Value | None]] = {}
        self.trace: Trace | None = None
        self.t_ns = 0
        self.changes: dict[int, Value | None] = {}
        self.seen: set[int] = set()

    def wrong(self, line: int, found: str, expected: str) -> TraceFormatError:
        return TraceFormatError(f"{self.path}:{line}: found {found}, expected {expected}")

    def take(self, token: Token) -> None:
        """Take the next word."""
        self.line = token.span.start.line
        action = _ACTIONS.get(token.kind)
        if action is not None:
            action(self, token.data)

    def enter(self, data: Any) -> None:
        self.scopes.append(data.ident)

    def leave(self, _: Any) -> None:
        if not self.scopes:
            raise self.wrong(self.line, "$upscope", "a $scope before it")
        self.scopes.pop()

    def set_scale(self, scale: Timescale) -> None:
        power = _SECONDS[scale.unit.value] + 9
        self.scale_ns = scale.magnitude * Fraction(10) ** power

    def declare(self, var: VarDecl) -> None:
        type_, convert = _reading(var)
        scopes = [scope for scope in self.scopes if scope != _TOP]
        name = ".".join([*scopes, var.ref_str])
        self.indices.setdefault(var.id_code, []).append(len(self.tags))
        self.tags.append(Tag(name, type_))
        self.convert[var.id_code] = convert

    def begin(self, _: Any) -> None:
        try:
            self.trace = Trace(TagTable(self.tags))
        except ValueError as error:
            raise self.wrong(self.line, str(error), "each tag once") from None

    def move(self, ticks: int) -> None:
        """Go on to a later instant."""
        t_ns = int(ticks * self.scale_ns)
        if t_ns < self.t_ns:
            raise self.wrong(self.line, f"the instant {t_ns} ns", f"one from {self.t_ns} ns on")
        if t_ns > self.t_ns:
            self.flush()
        self.t_ns = t_ns

    def change(self, data: Any) -> None:
        if data.id_code not in self.indices:
            raise self.wrong(self.line, f"the code {data.id_code!r}", "one that $var declared")
        value = self.convert[data.id_code](data.value)
        for index in self.indices[data.id_code]:
            if value is not None or index in self.seen:
                self.changes[index] = value
                self.seen.add(index)

    def flush(self) -> None:
        """End the instant: what changed in it is a frame."""
        if self.trace is None:
            raise self.wrong(self.line, f"the instant {self.t_ns} ns", "$enddefinitions before it")
        if self.changes or self.trace.frames:
            changes: tuple[Change, ...] = tuple(sorted(self.changes.items()))
            self.trace.observe(Frame(self.t_ns, len(self.trace.frames), changes))
        self.changes = {}

    def finish(self) -> Trace:
        """Return the trace; the last instant is its end."""
        if self.trace is None:
            raise self.wrong(self.line, "the end of the file", "$enddefinitions")
        self.flush()
        self.trace.end_ns = max(self.trace.end_ns, self.t_ns)
        return self.trace


def _reading(var: VarDecl) -> tuple[str, Callable[[Any], Value | None]]:
    """Return the type that a variable reads back as, and how its values are converted.

    Unknown and high-impedance states (`x`, `z`) are no values: the tag is not known then.
    """
    kind = var.type_.value
    if kind == "string":
        return "STRING", lambda text: _ESCAPED.sub(_unescaped, text)
    if kind in ("real", "realtime", "shortreal"):
        return "LREAL", float
    if var.size == 1:
        return "BOOL", lambda state: {"0": False, "1": True, 0: False, 1: True}.get(state)
    if kind in ("integer", "int", "shortint", "longint"):
        top = 1 << (var.size - 1)
        return "LINT", lambda bits: (bits ^ top) - top if isinstance(bits, int) else None
    return "ULINT", lambda bits: bits if isinstance(bits, int) else None


def _unescaped(match: re.Match[str]) -> str:
    code = match[1]
    return chr(int(code[1:], 16)) if len(code) > 1 else _ESCAPES.get(code, code)


_ACTIONS: dict[TokenKind, Callable[[_Reader, Any], None]] = {
    TokenKind.SCOPE: _Reader.enter,
    TokenKind.UPSCOPE: _Reader.leave,
    TokenKind.TIMESCALE: _Reader.set_scale,
    TokenKind.VAR: _Reader.declare,
    TokenKind.ENDDEFINITIONS: _Reader.begin,
    TokenKind.CHANGE_TIME: _Reader.move,
    TokenKind.CHANGE_SCALAR: _Reader.change,
    TokenKind.CHANGE_VECTOR: _Reader.change,
    TokenKind.CHANGE_REAL: _Reader.change,
    TokenKind.CHANGE_STRING: _Reader.change,
}
