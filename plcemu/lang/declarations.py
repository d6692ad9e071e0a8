"""What a text declares: POUs with their variables, types, globals and configurations."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from itertools import pairwise

from plcemu.lang import syntax as s
from plcemu.lang.configuration import parse_configuration
from plcemu.lang.cursor import Cursor, SyntaxFailure
from plcemu.lang.il import looks_like_il, parse_il
from plcemu.lang.lexer import Token
from plcemu.lang.report import Report
from plcemu.lang.sfc import ELEMENTS, parse_sfc
from plcemu.lang.sipn import looks_like_sipn, parse_sipn
from plcemu.lang.st import parse_statements
from plcemu.lang.typespecs import parse_initial, parse_type
from plcemu.lang.variables import SECTIONS, parse_section

_ENDS = ("END_PROGRAM", "END_FUNCTION_BLOCK", "END_FUNCTION", "END_TYPE", "END_CONFIGURATION")
_POUS = ("PROGRAM", "FUNCTION_BLOCK", "FUNCTION")
_OTHERS = ("TYPE", "VAR_GLOBAL", "CONFIGURATION")


def function_names(tokens: Iterable[Token]) -> frozenset[str]:
    """Return the names, in capitals, of the FUNCTIONs that texts declare."""
    return frozenset(name.upper for word, name in pairwise(tokens)
                     if word.kind == "name" and word.upper == "FUNCTION" and name.kind == "name")


def parse(tokens: list[Token], report: Report, functions: Collection[str] = ()) -> s.Unit:
    """Parse a whole text; every mistake goes to the report.

    `functions` are the names of the user's functions in all texts, in capitals.
    """
    cursor = Cursor(tokens, report, functions)
    pous: list[s.Pou] = []
    types: list[s.TypeDeclaration] = []
    global_variables: list[s.Variable] = []
    configurations: list[s.Configuration] = []
    while not cursor.at_end():
        try:
            if cursor.at(*_POUS):
                pous.append(_pou(cursor))
            elif cursor.at("TYPE"):
                types += _types(cursor)
            elif cursor.at("VAR_GLOBAL"):
                global_variables += parse_section(cursor)
            elif cursor.at("CONFIGURATION"):
                configuration, inner = parse_configuration(cursor)
                configurations.append(configuration)
                global_variables += inner
            elif not cursor.accept(";"):
                raise cursor.failure("PROGRAM, FUNCTION_BLOCK, FUNCTION, TYPE or CONFIGURATION")
        except SyntaxFailure:
            cursor.skip_to(*_POUS, *_OTHERS, *_ENDS, over=_ENDS)
    return s.Unit(tuple(pous), tuple(types), tuple(global_variables), tuple(configurations))


def _types(cursor: Cursor) -> list[s.TypeDeclaration]:
    cursor.advance()
    found = []
    while not cursor.at("END_TYPE"):
        name = cursor.identifier("a type's name or END_TYPE")
        cursor.expect(":", "between the type's name and what it is")
        spec = parse_type(cursor)
        initial = parse_initial(cursor) if cursor.accept(":=") else None
        if cursor.previous.upper != "END_STRUCT" or not cursor.at("END_TYPE"):
            cursor.expect(";", "after the type")
        found.append(s.TypeDeclaration(name.span, name.text, spec, initial))
    cursor.advance()
    cursor.accept(";")
    return found


def _pou(cursor: Cursor) -> s.Pou:
    kind = cursor.advance().upper
    name = cursor.identifier(f"the name of the {kind}")
    variables: list[s.Variable] = []
    if kind == "FUNCTION":
        cursor.expect(":", "and the type of the function's value")
        spec = parse_type(cursor)
        variables.append(s.Variable(name.span, name.text, "RESULT", spec, None, "", name.span))
        cursor.accept(";")
    while cursor.at(*SECTIONS):
        variables.extend(parse_section(cursor))
    body = _body(cursor)
    cursor.expect(f"END_{kind}", code="P0011")
    cursor.accept(";")
    return s.Pou(name.span, kind, name.text, tuple(variables), body)


def _body(cursor: Cursor) -> s.Body:
    if cursor.at(*ELEMENTS):
        return parse_sfc(cursor)
    if looks_like_sipn(cursor):
        return parse_sipn(cursor)
    if looks_like_il(cursor):
        return parse_il(cursor)
    start = cursor.place()
    statements = parse_statements(cursor)
    return s.StBody(start.to(cursor.place()), statements)
