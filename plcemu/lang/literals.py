"""The values of literals (IEC 61131-3, 2.2, tables 4 to 8): text to (token kind, value, type)."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

from plcemu.base.dates import parse_date_ns, parse_dt_ns, parse_tod_ns
from plcemu.base.time import parse_duration_ns
from plcemu.base.types import ELEMENTARY, Value

Made = tuple[str, Value, str]

LITERAL_KINDS = ("int", "real", "time", "bool", "string", "date", "tod", "dt")
"""The kinds of tokens that are literals."""


class MalformedLiteral(ValueError):
    """A literal is wrong at one place: `begin` and `end` are offsets in its text."""

    def __init__(self, reason: str, begin: int, end: int) -> None:
        super().__init__(reason)
        self.begin, self.end = begin, end


# ---------------------------------------------------------------- numbers


def _digits(text: str) -> str:
    if text.endswith("_") or "__" in text:
        raise ValueError("single underscores may stand between digits only")
    return text.replace("_", "")


def _integer(text: str) -> Made:
    base, digits = text.split("#") if "#" in text else ("10", text)
    if base not in ("2", "8", "10", "16"):
        raise ValueError("numbers are written to the base 2, 8, 10 or 16")
    digits = _digits(digits)
    try:
        return "int", int(digits, int(base)), ""
    except ValueError:
        raise ValueError(f"these are no digits of a whole number to the base {base}") from None


def _real(text: str) -> Made:
    value = float(_digits(text))
    if not math.isfinite(value):
        raise ValueError("no REAL or LREAL is that large")
    return "real", value, ""


# ---------------------------------------------------------------- times and dates


def _time(text: str) -> Made:
    name = "LTIME" if text[0] in "lL" else "TIME"
    return "time", parse_duration_ns("T#" + text.split("#", 1)[1]), name


_DATES: dict[str, tuple[str, str, Callable[[str], int]]] = {
    **dict.fromkeys(("D", "DATE", "LD", "LDATE"), ("date", "DATE", parse_date_ns)),
    **dict.fromkeys(("TOD", "TIME_OF_DAY", "LTOD", "LTIME_OF_DAY"),
                    ("tod", "TIME_OF_DAY", parse_tod_ns)),
    **dict.fromkeys(("DT", "DATE_AND_TIME", "LDT", "LDATE_AND_TIME"),
                    ("dt", "DATE_AND_TIME", parse_dt_ns)),
}
"""Prefixes of dates (table 8) with the kind of token, the type and the reader."""


def _date(text: str) -> Made:
    prefix, rest = text.split("#", 1)
    kind, type_name, read = _DATES[prefix.upper()]
    return kind, read(rest), type_name


# ---------------------------------------------------------------- character strings


_ESCAPES = {"$": "$", "L": "\n", "N": "\n", "P": "\f", "R": "\r", "T": "\t"}
"""Table 6; the N of a new line is a line feed here."""

_ESCAPE = re.compile(r"\$([0-9A-Fa-f]{2}|.)")
_WIDE_ESCAPE = re.compile(r"\$([0-9A-Fa-f]{4}|.)")


def _string(text: str) -> Made:
    """Decode the escapes of a string; `$hh` in single quotes, `$hhhh` in double quotes."""
    wide = text[-1] == '"'
    begin = text.index(text[-1]) + 1
    escape = _WIDE_ESCAPE if wide else _ESCAPE
    parts, position = [], begin
    for match in escape.finditer(text, begin, len(text) - 1):
        parts += [text[position:match.start()], _escaped(match, text[-1])]
        position = match.end()
    value = "".join([*parts, text[position:-1]])
    try:
        value = value.encode("utf-16-le", "surrogatepass").decode("utf-16-le")
    except UnicodeDecodeError:
        raise ValueError("half of a surrogate pair is no character") from None
    name = "WSTRING" if wide else "STRING"
    if "#" in text[:begin] and text.split("#", 1)[0].upper() != name:
        raise ValueError(f"{'double' if wide else 'single'} quotes make a {name}")
    return "string", value, name


def _escaped(match: re.Match[str], quote: str) -> str:
    what = match[1]
    if len(what) > 1:
        return chr(int(what, 16))
    if what == quote:
        return quote
    if what.upper() not in _ESCAPES:
        digits = "four" if quote == '"' else "two"
        raise MalformedLiteral(f"after $ stand $, {quote}, L, N, P, R, T or {digits} hexadecimal "
                               "digits", match.start(), match.end())
    return _ESCAPES[what.upper()]


# ---------------------------------------------------------------- typed literals


_BOOLEANS = {"0": False, "1": True, "FALSE": False, "TRUE": True}
_HINTS = {"time": "write a duration such as T#1h30m or T#2.5s", "date": "write D#2024-02-29",
          "tod": "write TOD#15:36:55.36", "dt": "write DT#2024-02-29-15:36:55"}


def _typed(text: str) -> Made:
    type_name, rest = text.split("#", 1)
    type_name = type_name.upper()
    if type_name in ("T", "LT") or type_name in _DATES:
        raise ValueError(_HINTS[_DATES[type_name][0] if type_name in _DATES else "time"])
    if type_name not in ELEMENTARY:
        return "string", rest, type_name + "#"
    row = ELEMENTARY[type_name]
    if row.kind in _HINTS:
        raise ValueError(_HINTS[row.kind])
    if row.kind == "bool":
        if rest.upper() not in _BOOLEANS:
            raise ValueError("write BOOL#TRUE or BOOL#FALSE")
        return "bool", _BOOLEANS[rest.upper()], type_name
    if row.kind == "float":
        return "real", _float(rest), type_name
    sign = -1 if rest.startswith("-") else 1
    value = sign * int(_integer(rest.lstrip("+-"))[1])
    if not row.low <= value <= row.high:
        raise ValueError(f"{type_name} holds {row.low} to {row.high}")
    return "int", value, type_name


def _float(text: str) -> float:
    try:
        return float(_real(text)[1])
    except ValueError:
        raise ValueError("a number is expected, such as REAL#1.5") from None


MAKERS: dict[str, Callable[[str], Made]] = {
    "int": _integer, "based": _integer, "real": _real, "time": _time, "date": _date,
    "string": _string, "typed": _typed}
"""The readers by the name of the lexer's pattern; they raise ValueError or DurationError."""
