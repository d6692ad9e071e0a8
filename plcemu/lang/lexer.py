"""Source text to tokens (IEC 61131-3, 2.1 and 2.2).

The lexer never stops at a mistake: it reports it and goes on with the next character.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from plcemu.base.spans import Source, Span
from plcemu.base.time import DurationError
from plcemu.base.types import Value
from plcemu.lang.literals import MAKERS, MalformedLiteral
from plcemu.lang.report import Report

SOURCE_LIMIT = 10_000_000
"""The largest source text read, in characters."""


@dataclass(frozen=True, slots=True)
class Token:
    """One token.

    Attributes:
        kind: `name`, `int`, `real`, `time`, `bool`, `string`, `date`, `tod`, `dt`, `direct`, `op`,
            `bad` (reported already) or `end`.
        text: as written.
        value: of a literal: int, float, bool or text; times in ns, dates in ns since 1970-01-01,
            times of day in ns since midnight.
        type: the type written before a `#`, or empty.
        starts_line: whether it is the first token on its line.
    """

    kind: str
    text: str
    span: Span
    value: Value = 0
    type: str = ""
    starts_line: bool = False

    @property
    def upper(self) -> str:
        """The text in capitals, as keywords are compared."""
        return self.text.upper()


_TOKEN = re.compile(r"""
    (?P<space>[ \t\r\f\v]+)
  | (?P<newline>\n)
  | (?P<line_comment>//[^\n]*)
  | (?P<comment>\(\*|/\*)
  | (?P<pragma>\{[^}\n]*\})
  | (?P<time>(?:[Ll]?[Tt][Ii][Mm][Ee]|[Ll]?[Tt])\#-?[0-9][0-9A-Za-z_.]*)
  | (?P<date>(?i:L?(?:DATE|D|TIME_OF_DAY|TOD|DATE_AND_TIME|DT))\#[0-9][0-9_]*(?:[-:.][0-9_]+)*)
  | (?P<string>(?:(?i:W?STRING)\#)?(?:'(?:\$.|[^$'\n])*'|"(?:\$.|[^$"\n])*"))
  | (?P<typed>[A-Za-z_][A-Za-z0-9_]*\#(?:[0-9]+\#[0-9A-Fa-f_]+|[+-]?[0-9][0-9_]*(?:\.[0-9][0-9_]*)?
        (?:[eE][+-]?[0-9]+)?|[A-Za-z_][A-Za-z0-9_]*))
  | (?P<based>(?:2|8|16)\#[0-9A-Fa-f_]*)
  | (?P<real>[0-9][0-9_]*(?:\.[0-9][0-9_]*(?:[eE][+-]?[0-9]+)?|[eE][+-]?[0-9]+(?!\w)))
  | (?P<int>[0-9][0-9_]*)
  | (?P<direct>%[A-Za-z*][A-Za-z0-9.*]*)
  | (?P<name>[A-Za-z_][A-Za-z0-9_]*+(?!\w))
  | (?P<foreign>[^\W\d]\w*)
  | (?P<op>:=|=>|<>|<=|>=|\*\*|\.\.|[-+*/()\[\],;:=<>&.\#])
""", re.VERBOSE)

_COMMENT_ENDS = {"(*": ("*)", re.compile(r"\(\*|\*\)")), "/*": ("*/", re.compile(r"/\*|\*/"))}


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
        start = position
        if match is None or match.lastgroup == "foreign":
            position = _bad_text(source, match, start, report)
            tokens.append(Token("bad", "", Span(source, start, position), starts_line=fresh))
            fresh = False
            continue
        kind, position = str(match.lastgroup), match.end()
        if kind == "newline":
            fresh = True
        elif kind == "comment":
            end = _skip_comment(source, start, report)
            position = len(text) if end is None else end
            if end is None:
                tokens.append(Token("bad", "", Span(source, start, position), starts_line=fresh))
            fresh = fresh or "\n" in text[start:position]
        elif kind not in ("space", "line_comment", "pragma"):
            tokens.append(_token(kind, match[0], Span(source, start, position), fresh, report))
            fresh = False
    tokens.append(Token("end", "end of text", Span(source, len(text), len(text)), starts_line=True))
    return tokens


def _bad_text(source: Source, match: re.Match[str] | None, position: int, report: Report) -> int:
    """Report what is no token, at its first wrong character; return the offset after it."""
    if match is not None:
        wrong = next(i for i in range(*match.span()) if not source.text[i].isascii())
        report.error("P0001", Span(source, wrong, wrong + 1),
                     f"unexpected character {source.text[wrong]!r} in a name",
                     "names have the letters A to Z, digits and underscores")
        return match.end()
    char = source.text[position]
    if char in "'\"":
        end = source.text.find("\n", position)
        end = len(source.text) if end < 0 else end
        report.error("P0002", Span(source, position, end), "the string does not end on its line")
        return end
    report.error("P0001", Span(source, position, position + 1), f"unexpected character {char!r}")
    return position + 1


def _skip_comment(source: Source, start: int, report: Report) -> int | None:
    """Return the offset after a comment, None if it does not end; comments nest."""
    closing, ends = _COMMENT_ENDS[source.text[start:start + 2]]
    depth = 0
    for match in ends.finditer(source.text, start):
        depth += -1 if match[0] == closing else 1
        if not depth:
            return match.end()
    report.error("P0002", Span(source, start, start + 2),
                 f"the comment does not end; {closing} is missing")
    return None


def _token(kind: str, text: str, span: Span, fresh: bool, report: Report) -> Token:
    maker = MAKERS.get(kind)
    if maker is None:
        if kind == "name" and text.upper() in ("TRUE", "FALSE"):
            return Token("bool", text, span, text.upper() == "TRUE", "", fresh)
        return Token(kind, text, span, starts_line=fresh)
    try:
        made, value, type_name = maker(text)
    except (ValueError, DurationError) as problem:
        place = span
        if isinstance(problem, MalformedLiteral):
            place = Span(span.source, span.start + problem.begin, span.start + problem.end)
        report.error("P0003", place, f"malformed literal {text!r}", str(problem))
        made, value, type_name = "int", 0, ""
    return Token(made, text, span, value, type_name, fresh)
