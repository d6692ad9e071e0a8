"""Structured Text: expressions and statements (IEC 61131-3, 3.3)."""

from __future__ import annotations

import re
from collections.abc import Callable

from plcemu.base.spans import Span
from plcemu.lang import syntax as s
from plcemu.lang.cursor import NESTING_LIMIT, Cursor, NestedTooDeeply, SyntaxFailure
from plcemu.lang.lexer import Token
from plcemu.lang.literals import LITERAL_KINDS

# One row a level of precedence, the loosest first: sign -> operator (table 55).
_LEVELS: tuple[dict[str, str], ...] = (
    {"OR": "OR"},
    {"XOR": "XOR"},
    {"AND": "AND", "&": "AND"},
    {"=": "EQ", "<>": "NE"},
    {"<": "LT", ">": "GT", "<=": "LE", ">=": "GE"},
    {"+": "ADD", "-": "SUB"},
    {"*": "MUL", "/": "DIV", "MOD": "MOD"},
    {"**": "EXPT"},
)
_BINDS = {sign: (level, op) for level, row in enumerate(_LEVELS) for sign, op in row.items()}
_BINDS_NOTHING = (-1, "")

_AFTER_LABEL = (":", "..", ",", "+", "-", "*")
"""Signs after a name that make it the label of a branch of CASE, and no statement."""

_ENDS = ("END_IF", "ELSIF", "ELSE", "END_CASE", "END_FOR", "END_WHILE", "UNTIL", "END_REPEAT",
         "END_PROGRAM", "END_FUNCTION_BLOCK", "END_FUNCTION", "END_ACTION", "END_TRANSITION",
         "PROGRAM", "FUNCTION_BLOCK", "ACTION", "TRANSITION", "STEP", "INITIAL_STEP", "END_STEP")

_COMPOUNDS = {"IF": "END_IF", "CASE": "END_CASE", "FOR": "END_FOR", "WHILE": "END_WHILE",
              "REPEAT": "END_REPEAT"}
"""The statements that hold others, with the keywords that close them."""


def parse_expression(cursor: Cursor) -> s.Expr:
    """Parse one expression.

    Raises:
        SyntaxFailure: it is malformed; the report says how.
    """
    cursor.enter()
    try:
        return _binary(cursor, 0)
    finally:
        cursor.leave()


def _binary(cursor: Cursor, level: int) -> s.Expr:
    left, powers = _unary(cursor), 0
    while True:
        binds, op = _BINDS.get(cursor.word, _BINDS_NOTHING)
        if binds < level:
            return left
        cursor.advance()
        right = _binary(cursor, binds + 1)
        left = _joined(op, left, right)
        powers += op == "EXPT"
        if powers > NESTING_LIMIT:
            raise cursor.too_deep()


def _joined(op: str, left: s.Expr, right: s.Expr) -> s.Expr:
    span = left.span.to(right.span)
    if op == "EXPT":
        operands = (s.Argument(left.span, "", left), s.Argument(right.span, "", right))
        return s.Call(span, op, operands)
    return s.Binary(span, op, left, right)


def _unary(cursor: Cursor) -> s.Expr:
    sign = cursor.accept("NOT", "-", "+")
    if sign is None:
        return _primary(cursor)
    cursor.enter()
    try:
        operand = _unary(cursor)
    finally:
        cursor.leave()
    if sign.text == "+":
        return operand
    op = "NOT" if sign.upper == "NOT" else "NEG"
    return s.Unary(sign.span.to(operand.span), op, operand)


def _primary(cursor: Cursor) -> s.Expr:
    token = cursor.token
    if token.kind in LITERAL_KINDS:
        cursor.advance()
        return s.Literal(token.span, token.kind, token.value, token.type)
    if token.kind == "direct":
        cursor.advance()
        return s.Direct(token.span, token.text)
    if cursor.at("NOT", "AND", "OR", "XOR", "MOD") and cursor.peek().text == "(":
        # Functions that are spelt like operators, in the form of a call.
        name_token = cursor.advance()
        arguments = parse_arguments(cursor)
        return s.Call(name_token.span.to(cursor.previous.span), name_token.text, arguments)
    if cursor.accept("("):
        inner = parse_expression(cursor)
        cursor.expect(")", "to close the parenthesis", "P0011")
        return inner
    name = parse_name(cursor, "an expression")
    if cursor.at("(") and len(name.parts) == 1:
        arguments = parse_arguments(cursor)
        return s.Call(name.span.to(cursor.previous.span), name.head, arguments)
    return name


def parse_name(cursor: Cursor, what: str) -> s.Name:
    """Parse a variable's name with its fields and subscripts."""
    return name_from(cursor, cursor.identifier(what))


_BIT = re.compile(r"(?:%[Xx])?([0-9]{1,2})")
"""A bit of a variable: `.3` or `.%X3` (3rd edition, 6.5.5)."""


def name_from(cursor: Cursor, first: Token) -> s.Name:
    """Parse the fields, subscripts and the bit that follow a name."""
    parts: list[str | int | tuple[s.Expr, ...]] = [first.text]
    while True:
        if cursor.at(".") and cursor.peek().kind == "name":
            cursor.advance()
            parts.append(cursor.advance().text)
        elif cursor.at("["):
            cursor.advance()
            parts.append(_subscripts(cursor))
        elif cursor.at(".") and (bit := _BIT.fullmatch(cursor.peek().text)):
            cursor.advance()
            cursor.advance()
            parts.append(int(bit[1]))
        else:
            return s.Name(first.span.to(cursor.previous.span), tuple(parts))


def _subscripts(cursor: Cursor) -> tuple[s.Expr, ...]:
    subscripts = [parse_expression(cursor)]
    while cursor.accept(","):
        subscripts.append(parse_expression(cursor))
    cursor.expect("]", "to close the subscript", "P0011")
    return tuple(subscripts)


def parse_arguments(cursor: Cursor, value: Callable[[Cursor], s.Expr] = parse_expression,
                    ) -> tuple[s.Argument, ...]:
    """Parse the arguments of a call from `(` to `)`; `value` parses that of an input."""
    cursor.expect("(")
    arguments: list[s.Argument] = []
    while not cursor.at(")"):
        arguments.append(_argument(cursor, value))
        if not cursor.accept(","):
            break
    cursor.expect(")", "to close the call", "P0011")
    return tuple(arguments)


def _argument(cursor: Cursor, parse_value: Callable[[Cursor], s.Expr]) -> s.Argument:
    start = cursor.token.span
    negated_output = cursor.at("NOT") and cursor.peek(2).text == "=>"
    if negated_output:
        cursor.advance()
    name = ""
    if cursor.token.kind == "name" and cursor.peek().text in (":=", "=>"):
        name = cursor.advance().text
        if cursor.advance().text == "=>":
            target = parse_expression(cursor)
            return s.Argument(start.to(target.span), name, target, True, negated_output)
    value = parse_value(cursor)
    return s.Argument(start.to(value.span), name, value)


# ---------------------------------------------------------------- statements


def parse_statements(cursor: Cursor, in_case: bool = False) -> tuple[s.Statement, ...]:
    """Parse statements up to a keyword that ends them; a mistake costs its statement only.

    In a branch of CASE the label of the next branch ends them too.
    """
    statements: list[s.Statement] = []
    while not cursor.at_end() and not cursor.at(*_ENDS):
        if cursor.accept(";"):
            continue
        cursor.mend_closer()
        if cursor.at(*_ENDS):
            break
        if in_case and _starts_case_label(cursor):
            break
        begin = cursor.index
        try:
            statements.append(_statement(cursor))
        except SyntaxFailure:
            _skip_statement(cursor, begin)
    return tuple(statements)


def _skip_statement(cursor: Cursor, begin: int) -> None:
    """Skip the rest of a statement, with all that the compound statements in it hold."""
    open_ = _Open()
    for token in cursor.since(begin):
        open_.follow(token)
    while not cursor.at_end():
        if cursor.at(*_ENDS) and not open_.takes(cursor.token):
            return
        token = cursor.advance()
        open_.follow(token)
        if not open_.closers and token.text == ";":
            return


class _Open:
    """The compound statements that are open while tokens are skipped, as their closing keywords."""

    def __init__(self) -> None:
        self.closers: list[str] = []
        self._counts = dict.fromkeys(_COMPOUNDS.values(), 0)

    def takes(self, token: Token) -> bool:
        """Whether a keyword that ends statements belongs to one of the open ones."""
        return bool(self.closers) and (token.upper in ("ELSE", "ELSIF", "UNTIL")
                                       or self._counts.get(token.upper, 0) > 0)

    def follow(self, token: Token) -> None:
        """Open or close what a token opens or closes."""
        if token.kind != "name":
            return
        if token.upper in _COMPOUNDS:
            self.closers.append(_COMPOUNDS[token.upper])
            self._counts[self.closers[-1]] += 1
        while self._counts.get(token.upper, 0) > 0:
            closed = self.closers.pop()
            self._counts[closed] -= 1
            if closed == token.upper:
                break


def _starts_case_label(cursor: Cursor) -> bool:
    """Whether a label of CASE begins here."""
    if cursor.token.kind in ("int", "string") or cursor.at("-", "+"):
        return True
    return cursor.token.kind == "name" and cursor.peek().text in _AFTER_LABEL


def _statement(cursor: Cursor) -> s.Statement:
    parser = _STATEMENTS.get(cursor.word)
    if cursor.word == "CONTINUE" and cursor.peek().text == ";":
        parser = _continue  # no keyword of the 2nd edition: elsewhere it is a name
    cursor.enter()
    try:
        statement = parser(cursor, cursor.advance().span) if parser else _assign_or_call(cursor)
    finally:
        cursor.leave()
    if not cursor.accept(";"):
        missing = cursor.failure("';' after the statement")
        if not cursor.token.starts_line:
            raise missing
    return statement


def _header(cursor: Cursor, keyword: str, context: str) -> s.Expr | None:
    """Parse the expression up to THEN, DO or OF; None if it is wrong but the keyword is there."""
    try:
        expr = parse_expression(cursor)
        cursor.expect(keyword, context)
    except NestedTooDeeply:
        raise
    except SyntaxFailure:
        cursor.skip_to(keyword, ";", *_COMPOUNDS, *_ENDS)
        if not cursor.accept(keyword):
            raise
        return None
    return expr


def _assign_or_call(cursor: Cursor) -> s.Statement:
    token = cursor.token
    target: s.Name | s.Direct
    if token.kind == "direct":
        cursor.advance()
        target = s.Direct(token.span, token.text)
    else:
        target = parse_name(cursor, "a statement")
        if cursor.at("("):
            arguments = parse_arguments(cursor)
            return s.Invoke(token.span.to(cursor.previous.span), target, arguments)
    cursor.expect(":=", "or '(' after a name that begins a statement")
    value = parse_expression(cursor)
    return s.Assign(token.span.to(value.span), target, value)


def _if(cursor: Cursor, start: Span) -> s.Statement:
    branches: list[tuple[s.Expr, tuple[s.Statement, ...]]] = []
    otherwise: tuple[s.Statement, ...] = ()
    while True:
        condition = _header(cursor, "THEN", "after the condition")
        body = parse_statements(cursor)
        if condition is not None:
            branches.append((condition, body))
        if not cursor.accept("ELSIF"):
            break
    if cursor.accept("ELSE"):
        otherwise = parse_statements(cursor)
    cursor.expect("END_IF", code="P0011")
    return s.If(start.to(cursor.previous.span), tuple(branches), otherwise)


def _case(cursor: Cursor, start: Span) -> s.Statement:
    selector = _header(cursor, "OF", "after the selector of CASE")
    branches = []
    while not cursor.at_end() and not cursor.at(*_ENDS):
        ranges = [_range(cursor)]
        while cursor.accept(","):
            ranges.append(_range(cursor))
        cursor.expect(":", "after the labels of a CASE branch")
        branches.append((tuple(ranges), parse_statements(cursor, in_case=True)))
    otherwise = parse_statements(cursor) if cursor.accept("ELSE") else ()
    cursor.expect("END_CASE", code="P0011")
    span = start.to(cursor.previous.span)
    return s.Case(span, selector or s.Literal(span, "int", 0), tuple(branches), otherwise)


def _range(cursor: Cursor) -> tuple[s.Expr, s.Expr]:
    low = parse_expression(cursor)
    return low, parse_expression(cursor) if cursor.accept("..") else low


def _for(cursor: Cursor, start: Span) -> s.Statement:
    control = parse_name(cursor, "the control variable of FOR")
    cursor.expect(":=")
    first = parse_expression(cursor)
    cursor.expect("TO")
    last = parse_expression(cursor)
    step = parse_expression(cursor) if cursor.accept("BY") else None
    cursor.expect("DO", "after the range of FOR")
    body = parse_statements(cursor)
    cursor.expect("END_FOR", code="P0011")
    return s.For(start.to(cursor.previous.span), control, first, last, step, body)


def _while(cursor: Cursor, start: Span) -> s.Statement:
    condition = _header(cursor, "DO", "after the condition")
    body = parse_statements(cursor)
    cursor.expect("END_WHILE", code="P0011")
    span = start.to(cursor.previous.span)
    return s.While(span, condition or s.Literal(span, "bool", False), body)


def _repeat(cursor: Cursor, start: Span) -> s.Statement:
    body = parse_statements(cursor)
    cursor.expect("UNTIL", code="P0011")
    condition = parse_expression(cursor)
    cursor.accept(";")
    cursor.expect("END_REPEAT", code="P0011")
    return s.Repeat(start.to(cursor.previous.span), body, condition)


def _continue(_: Cursor, span: Span) -> s.Statement:
    return s.Exit(span, goes_on=True)


_STATEMENTS: dict[str, Callable[[Cursor, Span], s.Statement]] = {
    "IF": _if, "CASE": _case, "FOR": _for, "WHILE": _while, "REPEAT": _repeat,
    "EXIT": lambda _, span: s.Exit(span), "RETURN": lambda _, span: s.Return(span),
}
