"""Instruction List (IEC 61131-3, 3.2): one table of operators, one instruction a line."""

from __future__ import annotations

from dataclasses import dataclass

from plcemu.base.errors import did_you_mean
from plcemu.lang import syntax as s
from plcemu.lang.cursor import RESERVED, Cursor, NestedTooDeeply, SyntaxFailure
from plcemu.lang.st import name_from, parse_arguments


@dataclass(frozen=True, slots=True)
class Operator:
    """An IL operator (table 52).

    Attributes:
        modifiers: of `N`, `C` and `(`, those it takes.
        operand: `value`, `variable`, `label`, `call` or `none`.
    """

    modifiers: str
    operand: str


OPERATORS: dict[str, Operator] = {
    "LD": Operator("N", "value"),
    "ST": Operator("N", "variable"),
    "S": Operator("", "variable"),
    "R": Operator("", "variable"),
    "AND": Operator("N(", "value"),
    "&": Operator("N(", "value"),
    "OR": Operator("N(", "value"),
    "XOR": Operator("N(", "value"),
    "NOT": Operator("", "none"),
    **{op: Operator("(", "value") for op in
       ("ADD", "SUB", "MUL", "DIV", "MOD", "GT", "GE", "EQ", "NE", "LE", "LT")},
    "JMP": Operator("CN", "label"),
    "CAL": Operator("CN", "call"),
    "RET": Operator("CN", "none"),
}

_SPELLINGS: dict[str, tuple[str, bool, bool]] = {}
for _op, _row in OPERATORS.items():
    _SPELLINGS[_op] = (_op, False, False)
    if "C" in _row.modifiers:
        _SPELLINGS[_op + "C"] = (_op, False, True)
        _SPELLINGS[_op + "CN"] = (_op, True, True)
    elif "N" in _row.modifiers and _op != "&":
        _SPELLINGS[_op + "N"] = (_op, True, False)
_SPELLINGS["&N"] = ("&", True, False)

_CLOSERS = ("END_PROGRAM", "END_FUNCTION_BLOCK", "END_FUNCTION", "END_ACTION", "END_TRANSITION")


def looks_like_il(cursor: Cursor) -> bool:
    """Whether a body that starts here is IL: no statement of ST begins like its first line."""
    token, following = cursor.token, cursor.peek()
    if token.kind == "name" and following.text == ":":
        third = cursor.peek(2)
        return third.starts_line or third.upper in _SPELLINGS or third.upper in RESERVED
    if token.upper in _SPELLINGS:
        return following.text not in (":=", ".", "[", ";") or following.starts_line
    return _misspelt(cursor)


def _misspelt(cursor: Cursor) -> bool:
    """Whether two words stand side by side on a line that nothing marks as ST."""
    if cursor.token.kind != "name" or cursor.token.upper in RESERVED:
        return False
    ahead = 1
    while not cursor.peek(ahead).starts_line:
        if cursor.peek(ahead).text in (";", ":=", "=", "("):
            return False
        ahead += 1
    return ahead > 1 and cursor.peek().kind in ("name", "direct", "int", "real", "bool", "time")


def parse_il(cursor: Cursor) -> s.IlBody:
    """Parse instructions up to the keyword that closes the body."""
    start = cursor.place()
    return s.IlBody(start.to(cursor.place()), _instructions(cursor, _CLOSERS))


def _instructions(cursor: Cursor, closers: tuple[str, ...]) -> tuple[s.Instruction, ...]:
    found: list[s.Instruction] = []
    while not cursor.at_end() and not cursor.at(*closers):
        if cursor.accept(";"):
            continue
        cursor.mend_closer()
        if cursor.token.kind == "name" and cursor.token.upper in RESERVED:
            break
        begin = cursor.index
        try:
            if found and not cursor.token.starts_line and cursor.token.upper not in _SPELLINGS \
                    and cursor.previous.text != ";":
                raise cursor.failure("the end of the line")
            found.append(_instruction(cursor))
        except SyntaxFailure as failure:
            _skip_line(cursor, begin, closers, isinstance(failure, NestedTooDeeply))
    return tuple(found)


def _skip_line(cursor: Cursor, begin: int, closers: tuple[str, ...], whole: bool) -> None:
    """Resume at the next line outside of the instruction's parentheses.

    A line that begins like an instruction is taken for one, unless the `whole` of it is skipped.
    """
    texts = [token.text for token in cursor.since(begin)]
    depth = texts.count("(") - texts.count(")")
    while not cursor.at_end() and not cursor.at(*_CLOSERS):
        if depth <= 0 and cursor.at(*closers):
            return
        if cursor.index > begin and cursor.token.starts_line and (
                depth <= 0 or (not whole and _begins(cursor))):
            return
        depth += {"(": 1, ")": -1}.get(cursor.advance().text, 0)


def _begins(cursor: Cursor) -> bool:
    """Whether an instruction begins here, and not an argument of a call."""
    return cursor.token.upper in _SPELLINGS and cursor.peek().text not in (":=", "=>")


def _instruction(cursor: Cursor) -> s.Instruction:
    start, label = cursor.token.span, ""
    if cursor.token.kind == "name" and cursor.peek().text == ":":
        label = cursor.advance().text
        cursor.advance()
        if cursor.token.starts_line or cursor.at(*_CLOSERS):
            return s.Instruction(start, label, "")
    op, negated, conditional = _operator(cursor)
    kind = OPERATORS[op].operand
    if kind == "value":
        return _with_value(cursor, s.Instruction(start, label, op, negated))
    if kind == "none":
        return s.Instruction(start, label, op, negated, conditional)
    if kind == "variable":
        operand = _operand(cursor, op)
        if not isinstance(operand, s.Name | s.Direct):
            cursor.report.error("P0013", operand.span, f"{op} takes a variable")
            raise SyntaxFailure
        return s.Instruction(start.to(operand.span), label, op, negated, False, operand)
    if kind == "label":
        _on_its_line(cursor, op)
        target = cursor.identifier(f"a label after {op}")
        operand = s.Name(target.span, (target.text,))
        return s.Instruction(start.to(target.span), label, op, negated, conditional, operand)
    return _call(cursor, s.Instruction(start, label, op, negated, conditional))


def _operator(cursor: Cursor) -> tuple[str, bool, bool]:
    token = cursor.token
    spelling = token.upper
    if token.kind == "op" and spelling == "&" and cursor.peek().upper == "N":
        cursor.advance()
        spelling = "&N"
    if spelling not in _SPELLINGS:
        if token.kind == "name":
            base = spelling.rstrip("CN")
            if base in OPERATORS and spelling != base:
                cursor.report.error("P0013", token.span, f"{base} takes no modifier "
                                    f"{spelling[len(base):]!r}")
                raise SyntaxFailure
            hint = did_you_mean(spelling, _SPELLINGS).removeprefix("; ")
            cursor.report.error("P0012", token.span, f"{token.text!r} is not an IL operator", hint)
            raise SyntaxFailure
        raise cursor.failure("an IL operator")
    cursor.advance()
    return _SPELLINGS[spelling]


def _on_its_line(cursor: Cursor, op: str) -> None:
    if cursor.token.starts_line or cursor.at_end():
        cursor.report.error("P0013", cursor.previous.span, f"{op} needs an operand on its line")
        raise SyntaxFailure


def _operand(cursor: Cursor, op: str) -> s.Expr:
    """Parse an operand: a literal, a variable or an address on the operator's own line."""
    _on_its_line(cursor, op)
    sign = cursor.token.span if cursor.at("-", "+") else None
    literal = cursor.peek() if sign else cursor.token
    if literal.kind in ("int", "real", "time", "bool", "string"):
        negative = sign is not None and cursor.advance().text == "-"
        cursor.advance()
        value = s.Literal(literal.span, literal.kind, literal.value, literal.type)
        return s.Unary(sign.to(literal.span), "NEG", value) if sign and negative else value
    if cursor.token.kind == "direct":
        token = cursor.advance()
        return s.Direct(token.span, token.text)
    first = cursor.token
    if first.kind != "name" or first.upper in RESERVED:
        raise cursor.failure(f"a variable or literal after {op}")
    cursor.advance()
    return name_from(cursor, first)


def _with_value(cursor: Cursor, head: s.Instruction) -> s.Instruction:
    if not cursor.at("(") or cursor.token.starts_line:
        operand = _operand(cursor, head.op)
        return s.Instruction(head.span.to(operand.span), head.label, head.op, head.negated,
                             False, operand)
    if "(" not in OPERATORS[head.op].modifiers:
        cursor.report.error("P0013", cursor.token.span, f"{head.op} takes no parenthesis")
        raise SyntaxFailure
    cursor.enter()
    try:
        cursor.advance()
        nested = _nested(cursor, head)
    finally:
        cursor.leave()
    cursor.expect(")", f"to close {head.op}(", "P0011")
    return s.Instruction(head.span.to(cursor.previous.span), head.label, head.op, head.negated,
                         False, None, nested)


def _nested(cursor: Cursor, head: s.Instruction) -> tuple[s.Instruction, ...]:
    """Parse the inside of a parenthesis; an operand right after it is loaded first (table 51a)."""
    first: tuple[s.Instruction, ...] = ()
    if not cursor.token.starts_line:
        operand = _operand(cursor, head.op)
        first = (s.Instruction(operand.span, "", "LD", False, False, operand),)
    rest = _instructions(cursor, (")", *_CLOSERS))
    if not first and not rest:
        raise cursor.failure(f"an operand inside {head.op}(")
    return first + rest


def _call(cursor: Cursor, head: s.Instruction) -> s.Instruction:
    name = _operand(cursor, "CAL")
    if not isinstance(name, s.Name):
        cursor.report.error("P0013", name.span, "CAL takes a function block instance")
        raise SyntaxFailure
    arguments = parse_arguments(cursor) if cursor.at("(") else ()
    return s.Instruction(head.span.to(cursor.previous.span), head.label, head.op, head.negated,
                         head.conditional, name, None, arguments)

