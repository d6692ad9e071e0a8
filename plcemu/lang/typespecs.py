"""Types and initial values as they are written (IEC 61131-3, 2.3.3 and 2.4.2)."""

from __future__ import annotations

from plcemu.lang import syntax as s
from plcemu.lang.cursor import Cursor
from plcemu.lang.st import parse_expression


def parse_type(cursor: Cursor) -> s.TypeSpec:
    """Parse a type where a variable, a field or a TYPE is declared.

    Raises:
        SyntaxFailure: it is malformed; the report says how.
    """
    cursor.enter()
    try:
        if cursor.at("ARRAY"):
            return _array(cursor)
        if cursor.at("STRUCT"):
            return _struct(cursor)
        if cursor.at("STRING", "WSTRING"):
            return _string(cursor)
        if cursor.at("("):
            return _enumeration(cursor)
        return _named(cursor)
    finally:
        cursor.leave()


def _named(cursor: Cursor) -> s.TypeSpec:
    token = cursor.identifier("a type")
    if not cursor.at("("):
        return s.NamedType(token.span, token.text)
    cursor.advance()
    low = parse_expression(cursor)
    cursor.expect("..", "between the limits of a subrange")
    high = parse_expression(cursor)
    cursor.expect(")", "to close the subrange", "P0011")
    return s.SubrangeSpec(token.span.to(cursor.previous.span), token.text, low, high)


def _array(cursor: Cursor) -> s.TypeSpec:
    start = cursor.advance().span
    cursor.expect("[", "after ARRAY")
    ranges = []
    while True:
        low = parse_expression(cursor)
        cursor.expect("..", "between the limits of an array")
        ranges.append((low, parse_expression(cursor)))
        if not cursor.accept(","):
            break
    cursor.expect("]", "to close the limits", "P0011")
    cursor.expect("OF", "before the type of the elements")
    element = parse_type(cursor)
    return s.ArraySpec(start.to(cursor.previous.span), tuple(ranges), element)


def _struct(cursor: Cursor) -> s.TypeSpec:
    start = cursor.advance().span
    fields: list[s.Variable] = []
    while not cursor.at("END_STRUCT"):
        names = [cursor.identifier("a field's name or END_STRUCT")]
        while cursor.accept(","):
            names.append(cursor.identifier("another field's name"))
        cursor.expect(":", "between the field's name and its type")
        spec = parse_type(cursor)
        initial = parse_initial(cursor) if cursor.accept(":=") else None
        cursor.expect(";", "after the field")
        fields += [s.Variable(n.span, n.text, "FIELD", spec, initial, "", n.span) for n in names]
    cursor.advance()
    return s.StructSpec(start.to(cursor.previous.span), tuple(fields))


def _string(cursor: Cursor) -> s.TypeSpec:
    start = cursor.advance()
    length = None
    closer = {"[": "]", "(": ")"}.get(cursor.token.text)
    if closer:
        cursor.advance()
        length = parse_expression(cursor)
        cursor.expect(closer, "to close the length", "P0011")
    return s.StringSpec(start.span.to(cursor.previous.span), start.upper == "WSTRING", length)


def _enumeration(cursor: Cursor) -> s.TypeSpec:
    start = cursor.advance().span
    members = []
    while True:
        name = cursor.identifier("a name of the enumeration")
        value = parse_expression(cursor) if cursor.accept(":=") else None
        members.append((name.text, value, name.span))
        if not cursor.accept(","):
            break
    cursor.expect(")", "to close the enumeration", "P0011")
    return s.EnumSpec(start.to(cursor.previous.span), tuple(members))


# ---------------------------------------------------------------- initial values


def parse_initial(cursor: Cursor) -> s.InitialValue:
    """Parse an initial value: an expression, a list of an array, or values of fields."""
    cursor.enter()
    try:
        if cursor.at("["):
            return _list(cursor)
        if cursor.at("(") and cursor.peek().kind == "name" and cursor.peek(2).text == ":=":
            return _fields(cursor)
        return parse_expression(cursor)
    finally:
        cursor.leave()


def _list(cursor: Cursor) -> s.ListValue:
    start = cursor.advance().span
    items: list[tuple[s.Expr | None, s.InitialValue | None]] = []
    while not cursor.at("]"):
        if cursor.token.kind == "int" and cursor.peek().text == "(":
            count = parse_expression(cursor)
            cursor.advance()
            value = None if cursor.at(")") else parse_initial(cursor)
            cursor.expect(")", "to close the repeated value", "P0011")
            items.append((count, value))
        else:
            items.append((None, parse_initial(cursor)))
        if not cursor.accept(","):
            break
    cursor.expect("]", "to close the initial values", "P0011")
    return s.ListValue(start.to(cursor.previous.span), tuple(items))


def _fields(cursor: Cursor) -> s.FieldValues:
    start = cursor.advance().span
    items = []
    while not cursor.at(")"):
        name = cursor.identifier("a field's name")
        cursor.expect(":=", "after the field's name")
        items.append((name.text, parse_initial(cursor), name.span))
        if not cursor.accept(","):
            break
    cursor.expect(")", "to close the fields' values", "P0011")
    return s.FieldValues(start.to(cursor.previous.span), tuple(items))


