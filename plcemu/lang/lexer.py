"""Source text to tokens (IEC 61131-3, 2.1 and 2.2).

The lexer never stops at a mistake: it reports it and goes on with the next character.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from plcemu.base.spans import Source, Span
from plcemu.base.time import DurationError, parse_duration_ns
from plcemu.base.types import ELEMENTARY
from plcemu.lang.report import Report

SOURCE_LIMIT = 10_000_000
"""The largest source text read, in characters."""


@dataclass(frozen=True, slots=True)
class Token:
    """One token.

    Attributes:
        kind: `name`, `int`, `real`, `time`, `bool`, `string`, `direct`, `op` or `end`.
        text: as written.
        value: of a literal: int, float, ns, bool or text.
        type: the type written before a `#`, or empty.
        starts_line: whether it is the first token on its line.
    """

    kind: str
    text: str
    span: Span
    value: int | float | str | bool = 0
    type: str = ""
    starts_line: bool = False

    @property
    def upper(self) -> str:
        """The text in capitals, as keywords are compared."""
        return self.text.upper()


_TOKEN = re.compile(r"""
    (?P<space>[ \t\r\f\v\ufeff]+)
  | (?P<newline>\n)
  | (?P<line_comment>//[^\n]*)
  | (?P<comment>\(\*|/\*)
  | (?P<pragma>\{[^}\n]*\})
  | (?P<time>(?:LTIME|TIME|LT|T)\#-?[0-9][0-9A-Za-z_.]*)
  | (?P<typed>[A-Za-z_][A-Za-z0-9_]*\#(?:[0-9]+\#[0-9A-Fa-f_]+|[+-]?[0-9][0-9_]*(?:\.[0-9][0-9_]*)?
        (?:[eE][+-]?[0-9]+)?|[A-Za-z_][A-Za-z0-9_]*))
  | (?P<based>(?:2|8|16)\#[0-9A-Fa-f_]+)
  | (?P<real>[0-9][0-9_]*\.[0-9][0-9_]*(?:[eE][+-]?[0-9]+)?)
  | (?P<int>[0-9][0-9_]*)
  | (?P<direct>%[A-Za-z*][A-Za-z0-9.*]*)
  | (?P<name>[A-Za-z_][A-Za-z0-9_]*)
  | (?P<string>'(?:\$.|[^$'\n])*'|"(?:\$.|[^$"\n])*")
  | (?P<op>:=|=>|<>|<=|>=|\*\*|\.\.|[-+*/()\[\],;:=<>&.\#])
""", re.VERBOSE | re.IGNORECASE)

_CLOSES = {"(*": "*)", "/*": "*/"}


def tokenize(source: Source, report: Report) -> list[Token]:
    """Return the tokens of a text, the last of kind `end`; mistakes go to the report."""
    if len(source.text) > SOURCE_LIMIT:
        report.error("P0100", Span(source, 0, 0),
                     f"the text has {len(source.text)} characters; the limit is {SOURCE_LIMIT}")
        return [Token("end", "", Span(source, 0, 0), starts_line=True)]
    tokens: list[Token] = []
    position, fresh, text = 0, True, source.text
    while position < len(text):
        match = _TOKEN.match(text, position)
        if match is None:
            position = _bad_character(source, position, report)
            continue
        kind, start, position = str(match.lastgroup), position, match.end()
        if kind == "newline":
            fresh = True
        elif kind == "comment":
            position = _skip_comment(source, start, report)
            fresh = fresh or "\n" in text[start:position]
        elif kind not in ("space", "line_comment", "pragma"):
            tokens.append(_token(kind, match[0], Span(source, start, position), fresh, report))
            fresh = False
    tokens.append(Token("end", "end of text", Span(source, len(text), len(text)), starts_line=True))
    return tokens


def _bad_character(source: Source, position: int, report: Report) -> int:
    char = source.text[position]
    if char in "'\"":
        end = source.text.find("\n", position)
        end = len(source.text) if end < 0 else end
        report.error("P0002", Span(source, position, end), "the string does not end on its line")
        return end
    report.error("P0001", Span(source, position, position + 1), f"unexpected character {char!r}")
    return position + 1


def _skip_comment(source: Source, start: int, report: Report) -> int:
    """Return the offset after a comment; comments of the form `(* *)` nest, as users expect."""
    opening = source.text[start:start + 2]
    closing, depth, position = _CLOSES[opening], 1, start + 2
    while depth:
        close = source.text.find(closing, position)
        if close < 0:
            report.error("P0002", Span(source, start, start + 2),
                         f"the comment does not end; {closing} is missing")
            return len(source.text)
        inner = source.text.find(opening, position, close)
        depth, position = (depth + 1, inner + 2) if inner >= 0 else (depth - 1, close + 2)
    return position


def _token(kind: str, text: str, span: Span, fresh: bool, report: Report) -> Token:
    maker = _LITERALS.get(kind)
    if maker is None:
        if kind == "name" and text.upper() in ("TRUE", "FALSE"):
            return Token("bool", text, span, text.upper() == "TRUE", "", fresh)
        return Token(kind, text, span, starts_line=fresh)
    try:
        made, value, type_name = maker(text)
    except (ValueError, DurationError) as problem:
        report.error("P0003", span, f"malformed literal {text!r}", str(problem))
        made, value, type_name = "int", 0, ""
    return Token(made, text, span, value, type_name, fresh)


def _digits(text: str) -> str:
    if text.endswith("_") or "__" in text:
        raise ValueError("single underscores may stand between digits only")
    return text.replace("_", "")


def _integer(text: str) -> tuple[str, int, str]:
    if "#" not in text:
        return "int", int(_digits(text)), ""
    base, digits = text.split("#")
    return "int", int(_digits(digits), int(base)), ""


def _real(text: str) -> tuple[str, float, str]:
    return "real", float(_digits(text)), ""


def _time(text: str) -> tuple[str, int, str]:
    name = "LTIME" if text[0] in "lL" else "TIME"
    return "time", parse_duration_ns("T#" + text.split("#", 1)[1]), name


def _string(text: str) -> tuple[str, str, str]:
    return "string", text[1:-1], "WSTRING" if text[0] == '"' else "STRING"


def _typed(text: str) -> tuple[str, int | float | str | bool, str]:
    type_name, rest = text.split("#", 1)
    type_name = type_name.upper()
    if type_name not in ELEMENTARY:
        return "string", rest, type_name + "#"
    kind = ELEMENTARY[type_name].kind
    if kind == "bool":
        values = {"0": False, "1": True, "FALSE": False, "TRUE": True}
        if rest.upper() not in values:
            raise ValueError("write BOOL#TRUE or BOOL#FALSE")
        return "bool", values[rest.upper()], type_name
    if kind == "float":
        return "real", float(_digits(rest)), type_name
    sign = -1 if rest.startswith("-") else 1
    value = sign * _integer(rest.lstrip("+-"))[1]
    row = ELEMENTARY[type_name]
    if not row.low <= value <= row.high:
        raise ValueError(f"{type_name} holds {row.low} to {row.high}")
    return "int", value, type_name


_LITERALS = {"int": _integer, "based": _integer, "real": _real, "time": _time,
             "string": _string, "typed": _typed}
