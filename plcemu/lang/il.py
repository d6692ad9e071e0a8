"""Instruction List (IEC 61131-3, 3.2): one table of operators, one instruction a line."""

from __future__ import annotations

from dataclasses import dataclass, replace

from plcemu.base.errors import did_you_mean
from plcemu.base.spans import Span
from plcemu.lang import functions
from plcemu.lang import syntax as s
from plcemu.lang.cursor import RESERVED, Cursor, NestedTooDeeply, SyntaxFailure
from plcemu.lang.lexer import Token
from plcemu.lang.literals import LITERAL_KINDS
from plcemu.lang.st import name_from, parse_arguments, parse_expression


@dataclass(frozen=True, slots=True)
class Operator:
    """An IL operator (table 52).

    Attributes:
        modifiers: of `N`, `C` and `(`, those it takes.
        operand: `value`, `variable`, `label`, `call`, `instance` or `none`.
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
    **{op: Operator("", "instance") for op in ("S1", "R1", "CLK", "CU", "CD", "PV", "IN", "PT")},
}
"""Table 52; the last row are the inputs of standard function blocks of table 54."""

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
    if is_function(cursor, token) and following.text not in (":=", ".", "[", ";", ":"):
        return following.text != "(" or _behind_parenthesis(cursor).text != ";"
    if token.kind == "name" and following.text == ":":
        third = cursor.peek(2)
        return third.starts_line or third.upper in _SPELLINGS or third.upper in RESERVED
    if token.upper in _SPELLINGS and following.text == "(" and not following.starts_line \
            and "(" not in OPERATORS[_SPELLINGS[token.upper][0]].modifiers:
        return False  # a call of an instance that is named like an operator
    if token.upper in _SPELLINGS:
        return following.text not in (":=", ".", "[", ";") or following.starts_line
    return _misspelt(cursor)


def is_function(cursor: Cursor, token: Token) -> bool:
    """Whether a token is the name of a function that is no operator by itself."""
    return token.kind == "name" and token.upper not in _SPELLINGS \
        and (token.upper in cursor.functions or functions.find(token.upper) is not None)


def _behind_parenthesis(cursor: Cursor) -> Token:
    """Return the token behind the parenthesis that opens after the one at the cursor."""
    ahead, depth = 1, 0
    while cursor.peek(ahead).kind != "end":
        depth += {"(": 1, ")": -1}.get(cursor.peek(ahead).text, 0)
        ahead += 1
        if not depth:
            break
    return cursor.peek(ahead)


def _misspelt(cursor: Cursor) -> bool:
    """Whether two words stand side by side on a line that nothing marks as ST."""
    if cursor.token.kind != "name" or cursor.token.upper in RESERVED:
        return False
    ahead = 1
    while not cursor.peek(ahead).starts_line:
        if cursor.peek(ahead).text in (";", ":=", "=", "("):
            return False
        ahead += 1
    return ahead > 1 and cursor.peek().kind in ("name", "direct", *LITERAL_KINDS)


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
                    and not is_function(cursor, cursor.token) and cursor.previous.text != ";":
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
    if is_function(cursor, cursor.token) or _is_formal(cursor):
        return _function(cursor, start, label)
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
    if kind == "instance":
        return _input(cursor, s.Instruction(start, label, op))
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
            known = [*_SPELLINGS, *functions.NAMES, *cursor.functions]
            hint = did_you_mean(spelling, known).removeprefix("; ")
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
    return _next_operand(cursor, op)


def _next_operand(cursor: Cursor, op: str) -> s.Expr:
    sign = cursor.token.span if cursor.at("-", "+") else None
    literal = cursor.peek() if sign else cursor.token
    if literal.kind in LITERAL_KINDS:
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
        if cursor.at(",") and not head.negated and "(" in OPERATORS[head.op].modifiers:
            return _with_operands(cursor, head, head.op, operand)
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
    arguments = parse_arguments(cursor, _argument) if cursor.at("(") else ()
    return s.Instruction(head.span.to(cursor.previous.span), head.label, head.op, head.negated,
                         head.conditional, name, None, arguments)


def _input(cursor: Cursor, head: s.Instruction) -> s.Instruction:
    """Parse the instance after an input operator such as CU (table 53, feature 3)."""
    name = _operand(cursor, head.op)
    if not isinstance(name, s.Name):
        cursor.report.error("P0013", name.span, f"{head.op} takes a function block instance")
        raise SyntaxFailure
    return input_operator(head, name)


def input_operator(head: s.Instruction, instance: s.Name) -> s.Instruction:
    """Return the instruction that gives the current result to the input its operator names."""
    argument = s.Argument(head.span, head.op, instance)
    return s.Instruction(head.span.to(instance.span), head.label, "INPUT", False, False, instance,
                         None, (argument,))


# ---------------------------------------------------------------- functions as operators


def _is_formal(cursor: Cursor) -> bool:
    """Whether an operator such as ADD is called formally here: `ADD(IN1 := a, IN2 := b)`."""
    return cursor.peek().text == "(" and cursor.word in OPERATORS \
        and cursor.peek(2).kind == "name" and cursor.peek(3).text == ":=" \
        and "(" in OPERATORS[cursor.word].modifiers


def _function(cursor: Cursor, start: Span, label: str) -> s.Instruction:
    """Parse a function's call, with all arguments in parentheses or with the further operands."""
    token = cursor.advance()
    head = s.Instruction(start, label, "FUNCTION")
    if cursor.at("(") and not cursor.token.starts_line:
        arguments = parse_arguments(cursor, _argument)
        return s.Instruction(start.to(cursor.previous.span), label, "FUNCTION(",
                             operand=s.Name(token.span, (token.text,)), arguments=arguments)
    if cursor.token.starts_line or cursor.at_end() or cursor.at(";", ")"):
        name = s.Name(token.span, (token.text,))
        return replace(head, span=start.to(token.span), operand=name)
    return _with_operands(cursor, head, token.text, _operand(cursor, token.text))


def _with_operands(cursor: Cursor, head: s.Instruction, name: str,
                   first: s.Expr) -> s.Instruction:
    """Parse further operands after the first; a comma may end the line."""
    operands = [first]
    while cursor.accept(","):
        operands.append(_next_operand(cursor, name))
    arguments = tuple(s.Argument(each.span, "", each) for each in operands)
    return s.Instruction(head.span.to(cursor.previous.span), head.label, "FUNCTION",
                         operand=s.Name(head.span, (name,)), arguments=arguments)


def _argument(cursor: Cursor) -> s.Expr:
    """Parse an argument's value: instructions in parentheses that begin with LD, or an operand."""
    if not (cursor.at("(") and cursor.peek().upper in ("LD", "LDN")
            and cursor.peek(2).kind not in ("op", "end")):
        return parse_expression(cursor)
    start = cursor.token.span
    cursor.enter()
    try:
        cursor.advance()
        inner = _instructions(cursor, (")", *_CLOSERS))
    finally:
        cursor.leave()
    cursor.expect(")", "to close the instructions of an argument", "P0011")
    return s.Nested(start.to(cursor.previous.span), inner)

