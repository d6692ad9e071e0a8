"""Program organisation units and their variables (IEC 61131-3, 2.4 and 2.5)."""

from __future__ import annotations

from plcemu.base.spans import Span
from plcemu.lang import syntax as s
from plcemu.lang.cursor import Cursor, SyntaxFailure
from plcemu.lang.il import looks_like_il, parse_il
from plcemu.lang.lexer import Token
from plcemu.lang.report import Report
from plcemu.lang.sfc import ELEMENTS, parse_sfc
from plcemu.lang.st import parse_expression, parse_statements

_POUS = ("PROGRAM", "FUNCTION_BLOCK")
_LATER = {"FUNCTION": "END_FUNCTION", "CONFIGURATION": "END_CONFIGURATION", "TYPE": "END_TYPE",
          "VAR_GLOBAL": "END_VAR", "RESOURCE": "END_RESOURCE"}
_SECTIONS = ("VAR", "VAR_INPUT", "VAR_OUTPUT", "VAR_TEMP")
_LATER_SECTIONS = ("VAR_IN_OUT", "VAR_EXTERNAL", "VAR_GLOBAL", "VAR_ACCESS")


def parse(tokens: list[Token], report: Report) -> list[s.Pou]:
    """Parse a whole text into its POUs; every mistake goes to the report."""
    cursor, pous = Cursor(tokens, report), []
    while not cursor.at_end():
        try:
            if cursor.at(*_POUS):
                pous.append(_pou(cursor))
                continue
            if cursor.at(*_LATER):
                what = cursor.token.upper
                report.error("P0090", cursor.token.span, f"{what} is not supported yet")
                cursor.skip_to(_LATER[what], over=(_LATER[what],))
                continue
            if not cursor.accept(";"):
                raise cursor.failure("PROGRAM or FUNCTION_BLOCK")
        except SyntaxFailure:
            cursor.skip_to(*_POUS, *_LATER, "END_PROGRAM", "END_FUNCTION_BLOCK",
                           over=("END_PROGRAM", "END_FUNCTION_BLOCK"))
    return pous


def _pou(cursor: Cursor) -> s.Pou:
    kind = cursor.advance().upper
    name = cursor.identifier(f"the name of the {kind}")
    variables: list[s.Variable] = []
    while cursor.at(*_SECTIONS, *_LATER_SECTIONS):
        variables.extend(_section(cursor))
    body = _body(cursor)
    cursor.expect(f"END_{kind}", code="P0011")
    cursor.accept(";")
    return s.Pou(name.span, kind, name.text, tuple(variables), body)


def _body(cursor: Cursor) -> s.Body:
    if cursor.at(*ELEMENTS):
        return parse_sfc(cursor)
    if looks_like_il(cursor):
        return parse_il(cursor)
    start = cursor.place()
    statements = parse_statements(cursor)
    return s.StBody(start.to(cursor.place()), statements)


def _section(cursor: Cursor) -> list[s.Variable]:
    keyword = cursor.advance()
    if keyword.upper in _LATER_SECTIONS:
        cursor.report.error("P0090", keyword.span, f"{keyword.upper} is not supported yet")
        cursor.skip_to("END_VAR", over=("END_VAR",))
        return []
    options = set()
    while cursor.at("CONSTANT", "RETAIN", "NON_RETAIN"):
        options.add(cursor.advance().upper)
    variables: list[s.Variable] = []
    failed = False
    while not cursor.at("END_VAR"):
        cursor.mend_closer()
        if cursor.at("END_VAR"):
            break
        if cursor.at_end() or cursor.at(*_POUS, *ELEMENTS, "END_PROGRAM", "END_FUNCTION_BLOCK"):
            # After a mistake the missing END_VAR is most likely the mistake itself.
            raise SyntaxFailure if failed else \
                cursor.failure(f"END_VAR to close {keyword.upper}", "P0011")
        try:
            variables.extend(_declaration(cursor, keyword.upper, options))
        except SyntaxFailure:
            failed = True
            cursor.skip_to(";", "END_VAR", "END_PROGRAM", "END_FUNCTION_BLOCK", over=(";",))
    cursor.advance()
    return variables


def _declaration(cursor: Cursor, section: str, options: set[str]) -> list[s.Variable]:
    names = [] if cursor.at("AT") else [cursor.identifier("a variable's name or END_VAR")]
    while names and cursor.accept(","):
        names.append(cursor.identifier("another variable's name"))
    address, address_span = "", cursor.token.span
    if cursor.accept("AT"):
        if cursor.token.kind != "direct":
            raise cursor.failure("an address such as %IX0.0 after AT")
        address, address_span = cursor.token.text, cursor.token.span
        cursor.advance()
        if len(names) > 1:
            cursor.report.error("P0030", address_span, "several variables cannot share one AT")
    cursor.expect(":", "between the variable's name and its type")
    type_name, type_span = _type(cursor)
    initial = parse_expression(cursor) if cursor.accept(":=") else None
    cursor.expect(";", "after the declaration")
    tokens = [(t.text, t.span) for t in names] or [(address, address_span)]
    return [s.Variable(span, name, section, type_name, type_span, initial, address, address_span,
                       "CONSTANT" in options, "RETAIN" in options) for name, span in tokens]


def _type(cursor: Cursor) -> tuple[str, Span]:
    if cursor.at("ARRAY", "STRUCT", "STRING", "WSTRING", "("):
        cursor.report.error("P0090", cursor.token.span,
                            f"{cursor.token.upper} types are not supported yet")
        raise SyntaxFailure
    token = cursor.identifier("a type")
    return token.text, token.span
