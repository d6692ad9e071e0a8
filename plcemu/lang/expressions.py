"""Expressions to IR: types are inferred from the leaves up, literals take the type around them."""

from __future__ import annotations

from plcemu.base.spans import Span
from plcemu.base.types import ELEMENTARY, ElementaryType
from plcemu.lang import syntax as s
from plcemu.lang.calls import Calls
from plcemu.lang.emitter import Emitter
from plcemu.lang.scope import constant_value
from plcemu.lang.types import (
    BOOL,
    DINT,
    INT,
    INT_LITERAL,
    LINT,
    REAL,
    REAL_LITERAL,
    TIME,
    common_type,
    widens,
)

ARITHMETIC = {"ADD": "add", "SUB": "sub", "MUL": "mul", "DIV": "div", "MOD": "mod"}
LOGIC = {"AND": "and", "OR": "or", "XOR": "xor"}
COMPARISON = {"EQ": "eq", "NE": "ne", "LT": "lt", "LE": "le", "GT": "gt", "GE": "ge"}

_NUMERIC = ("int", "uint", "float", "literal")
_KINDS = {"ADD": (*_NUMERIC, "time"), "SUB": (*_NUMERIC, "time"), "MUL": _NUMERIC,
          "DIV": _NUMERIC, "MOD": ("int", "uint", "literal"),
          "NEG": ("int", "float", "time", "literal"),
          **dict.fromkeys((*LOGIC, "NOT"), ("bool", "bits"))}
"""The kinds of types that an operator works on; the comparisons take all."""


def operand_type(op: str, left: ElementaryType, right: ElementaryType) -> ElementaryType | None:
    """Return the type in which an operator works on its operands, or None if they do not fit it."""
    if op in LOGIC and INT_LITERAL in (left, right) and BOOL in (left, right):
        return BOOL
    if op in ("MUL", "DIV") and left.kind == "time" and right.kind in ("int", "uint", "literal") \
            and right is not REAL_LITERAL:
        return left
    common = common_type(left, right)
    if common is None or (op not in COMPARISON and common.kind not in _KINDS[op]):
        return None
    return common


def second_type(op: str, common: ElementaryType, right: ElementaryType) -> ElementaryType:
    """Return the type of an operator's second operand: of TIME times a number it is the number."""
    scales = op in ("MUL", "DIV") and common.kind == "time" and right.kind != "time"
    return LINT if scales else common


def operation(op: str, of: ElementaryType) -> str:
    """Return the IR operation for an operator on a type."""
    return f"{ARITHMETIC.get(op) or LOGIC.get(op) or COMPARISON[op]}.{of.machine}"


class Expressions:
    """Infers and emits expressions into one function."""

    def __init__(self, emitter: Emitter) -> None:
        self._out = self.out = emitter
        self.report = emitter.report
        self._calls = Calls(self)
        self._types: dict[s.Expr, ElementaryType | None] = {}

    # ------------------------------------------------------------ types

    def infer(self, expr: s.Expr) -> ElementaryType | None:
        """Return an expression's type (perhaps a literal's), or None after a reported mistake."""
        chain: list[s.Binary] = []
        while isinstance(expr, s.Binary) and expr not in self._types:
            chain.append(expr)
            expr = expr.left
        if expr not in self._types:
            self._types[expr] = self._infer_operand(expr)
        of = self._types[expr]
        for binary in reversed(chain):
            of = self._types[binary] = self._infer_binary(binary, of)
        return of

    def _infer_operand(self, expr: s.Expr) -> ElementaryType | None:
        if isinstance(expr, s.Literal):
            return _literal_type(expr, self._out)
        if isinstance(expr, s.Name | s.Direct):
            found = self._out.value_place(expr)
            return found[1] if found else None
        if isinstance(expr, s.Unary):
            return self._infer_unary(expr)
        if isinstance(expr, s.Call):
            return self._calls.infer(expr)
        return BOOL

    def _infer_binary(self, expr: s.Binary, left: ElementaryType | None) -> ElementaryType | None:
        right = self.infer(expr.right)
        if left is None or right is None:
            return None
        of = operand_type(expr.op, left, right)
        if of is None:
            self._out.report.error("P0023", expr.span,
                                   f"{expr.op} does not fit {left.name} and {right.name}",
                                   _conversion_hint(left, right))
            return None
        return BOOL if expr.op in COMPARISON else of

    def _infer_unary(self, expr: s.Unary) -> ElementaryType | None:
        of = self.infer(expr.operand)
        return of if of is not None and self._fits(expr, of) else None

    def _fits(self, expr: s.Unary | s.Binary, of: ElementaryType) -> bool:
        """Whether an operator works on a type; a mistake goes to the report."""
        if expr.op in COMPARISON or of.kind in _KINDS[expr.op]:
            return True
        self._out.report.error("P0023", expr.span, f"{expr.op} does not fit {of.name}")
        return False

    # ------------------------------------------------------------ code

    def emit(self, expr: s.Expr, target: ElementaryType) -> bool:
        """Push the value of an expression as a type; False after a reported mistake."""
        # Operators lean to the left, so a long sum is a deep tree: go down it in a loop.
        chain: list[tuple[s.Binary, ElementaryType, ElementaryType, ElementaryType]] = []
        while isinstance(expr, s.Binary):
            types = self._binary_types(expr, target)
            if types is None:
                return False
            chain.append((expr, *types, target))
            expr, target = expr.left, types[1]
        good = self._emit_operand(expr, target)
        for binary, of, common, wanted in reversed(chain):
            right = self.infer(binary.right)
            good = right is not None \
                and self.emit(binary.right, second_type(binary.op, common, right)) and good
            self._out.emit(operation(binary.op, common), None, binary.span)
            self.convert(of, wanted, binary.span)
        return good

    def _binary_types(self, expr: s.Binary,
                      target: ElementaryType) -> tuple[ElementaryType, ElementaryType] | None:
        """Return the types of a result and of the operands; None after a reported mistake."""
        of, left, right = self.infer(expr), self.infer(expr.left), self.infer(expr.right)
        if of is None or left is None or right is None:
            return None
        common = operand_type(expr.op, left, right)
        if of.kind == "literal":
            of = common = target
            if not self._takes_literal(expr, left, right, target):
                return None
        elif not self._widens(expr, of, target):
            return None
        if common is not None and common.kind == "literal":
            common = default_type(expr, common)
        return (of, common) if common is not None else None

    def _takes_literal(self, expr: s.Binary, left: ElementaryType, right: ElementaryType,
                       target: ElementaryType) -> bool:
        if target.kind != "float" and REAL_LITERAL in (left, right):
            return self._widens(expr, REAL_LITERAL, target)
        return self._widens(expr, INT_LITERAL, target) if target.kind not in _NUMERIC \
            else self._fits(expr, target)

    def _widens(self, expr: s.Expr, of: ElementaryType, target: ElementaryType) -> bool:
        if widens(of, target):
            return True
        self._out.report.error("P0023", expr.span, f"{of.name} where {target.name} is expected",
                               _conversion_hint(of, target))
        return False

    def _emit_operand(self, expr: s.Expr, target: ElementaryType) -> bool:
        of = self.infer(expr)
        if of is None:
            return False
        if _is_constant(expr):
            if of.kind != "literal" and not self._widens(expr, of, target):
                return False
            value = constant_value(expr, target, self._out.report)
            self._out.emit("const", (target.machine, value), expr.span)
            return value is not None
        if of.kind == "literal" and isinstance(expr, s.Call):
            of = target if target.kind in _NUMERIC else default_type(expr, of)
            if not self._widens(expr, of, target):
                return False
        elif of.kind == "literal":
            assert isinstance(expr, s.Unary)
            if not self._fits(expr, target):
                return False
            of = target
        elif not self._widens(expr, of, target):
            return False
        good = self._emit_natural(expr, of)
        self.convert(of, target, expr.span)
        return good

    def _emit_natural(self, expr: s.Expr, of: ElementaryType) -> bool:
        out = self._out
        if isinstance(expr, s.Name | s.Direct):
            found = out.value_place(expr)
            if found:
                out.load(found[0], found[1], expr.span)
            return found is not None
        if isinstance(expr, s.Unary):
            good = self.emit(expr.operand, of)
            out.emit(f"{expr.op.lower()}.{of.machine}", None, expr.span)
            return good
        if isinstance(expr, s.Call):
            return self._calls.emit(expr, of)
        assert isinstance(expr, s.Evaluate)
        out.emit("addr", ("this", 0), expr.span)
        out.emit("call", expr.function, expr.span)
        return True

    def emit_natural(self, expr: s.Expr) -> ElementaryType | None:
        """Push the value of an expression in its own type and return it."""
        of = self.infer(expr)
        if of is None:
            return None
        of = default_type(expr, of)
        return of if self.emit(expr, of) else None

    def convert(self, source: ElementaryType, target: ElementaryType, span: Span) -> None:
        """Convert the value on the stack."""
        if source.machine != target.machine:
            self._out.emit(f"to.{source.machine}.{target.machine}", None, span)


def default_type(expr: s.Expr, of: ElementaryType) -> ElementaryType:
    """Return the type that literals take where nothing around them asks for one."""
    if of is REAL_LITERAL:
        return REAL
    if of is not INT_LITERAL:
        return of
    low, high, pending = 0, 0, [expr]
    while pending:
        each = pending.pop()
        if isinstance(each, s.Binary):
            pending += [each.left, each.right]
        elif isinstance(each, s.Literal):
            high = max(high, int(each.value))
        elif isinstance(each, s.Unary) and isinstance(each.operand, s.Literal):
            low = min(low, -int(each.operand.value))
        elif isinstance(each, s.Unary):
            pending.append(each.operand)
        elif isinstance(each, s.Call):
            pending += [argument.value for argument in each.arguments]
    return next((row for row in (INT, DINT) if row.low <= low and high <= row.high), LINT)


def _is_constant(expr: s.Expr) -> bool:
    """Whether the expression is a literal with at most a sign."""
    if isinstance(expr, s.Unary) and expr.op == "NEG":
        expr = expr.operand
    return isinstance(expr, s.Literal)


def _literal_type(expr: s.Literal, out: Emitter) -> ElementaryType | None:
    if expr.kind == "string":
        out.report.error("P0090", expr.span, "strings and enumerations are not supported yet")
        return None
    if expr.kind == "time":
        return TIME
    if expr.type:
        return ELEMENTARY[expr.type]
    return {"int": INT_LITERAL, "real": REAL_LITERAL, "bool": BOOL}[expr.kind]


def _conversion_hint(source: ElementaryType, target: ElementaryType) -> str:
    if "literal" in (source.kind, target.kind) or source == target:
        return ""
    if source.kind in ("int", "uint", "float", "bits") and target.kind in ("int", "uint", "float"):
        return "this would lose information"
    return ""
