"""Sections of variables (IEC 61131-3, 2.4.3)."""

from __future__ import annotations

from plcemu.lang import syntax as s
from plcemu.lang.cursor import Cursor, SyntaxFailure
from plcemu.lang.sfc import ELEMENTS
from plcemu.lang.typespecs import parse_initial, parse_type

SECTIONS = ("VAR", "VAR_INPUT", "VAR_OUTPUT", "VAR_IN_OUT", "VAR_TEMP", "VAR_EXTERNAL",
            "VAR_GLOBAL", "VAR_ACCESS")

_OPTIONS = ("CONSTANT", "RETAIN", "NON_RETAIN", "PERSISTENT")
_STOPS = ("PROGRAM", "FUNCTION_BLOCK", "FUNCTION", "END_PROGRAM", "END_FUNCTION_BLOCK",
          "END_FUNCTION", "RESOURCE", "END_RESOURCE", "END_CONFIGURATION", *ELEMENTS)


def parse_section(cursor: Cursor) -> list[s.Variable]:
    """Parse one section, from its keyword to END_VAR; a mistake costs its declaration only."""
    keyword = cursor.advance()
    if keyword.upper == "VAR_ACCESS":
        # Access paths are for communication, which the tag table serves: they are read over.
        cursor.skip_to("END_VAR", over=("END_VAR",))
        return []
    options = set()
    while cursor.at(*_OPTIONS):
        options.add(cursor.advance().upper)
    variables: list[s.Variable] = []
    failed = False
    while not cursor.at("END_VAR"):
        cursor.mend_closer()
        if cursor.at("END_VAR"):
            break
        if cursor.at_end() or cursor.at(*_STOPS):
            # After a mistake the missing END_VAR is most likely the mistake itself.
            raise SyntaxFailure if failed else \
                cursor.failure(f"END_VAR to close {keyword.upper}", "P0011")
        try:
            variables.extend(_declaration(cursor, keyword.upper, options))
        except SyntaxFailure:
            failed = True
            cursor.skip_to(";", "END_VAR", *_STOPS, over=(";",))
    cursor.advance()
    cursor.accept(";")
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
    spec = parse_type(cursor)
    initial = parse_initial(cursor) if cursor.accept(":=") else None
    edge = _edge(cursor, section, spec)
    cursor.expect(";", "after the declaration")
    tokens = [(t.text, t.span) for t in names] or [(address, address_span)]
    return [s.Variable(span, name, section, spec, initial, address, address_span,
                       "CONSTANT" in options, _retention(options), edge)
            for name, span in tokens]


def _retention(options: set[str]) -> bool | None:
    if options & {"RETAIN", "PERSISTENT"}:
        return True
    return False if "NON_RETAIN" in options else None


def _edge(cursor: Cursor, section: str, spec: s.TypeSpec) -> str:
    """Parse R_EDGE or F_EDGE, which only a BOOL input has (table 33)."""
    token = cursor.accept("R_EDGE", "F_EDGE")
    if token is None:
        return ""
    if section != "VAR_INPUT" or not isinstance(spec, s.NamedType) or spec.name.upper() != "BOOL":
        cursor.report.error("P0023", token.span, f"{token.upper} takes a BOOL in VAR_INPUT")
    return token.upper
