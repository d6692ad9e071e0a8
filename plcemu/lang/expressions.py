"""Expressions to IR: types are inferred from the leaves up, literals take the type around them."""

from __future__ import annotations

from plcemu.base.spans import Span
from plcemu.base.types import ELEMENTARY, ElementaryType
from plcemu.lang import syntax as s
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
LOGIC = {"AND": "and", "OR": "or", "XOR": "xor", "&": "and"}
COMPARISON = {"EQ": "eq", "NE": "ne", "LT": "lt", "LE": "le", "GT": "gt", "GE": "ge"}

_NUMERIC = ("int", "uint", "float", "literal")
_KINDS = {"ADD": (*_NUMERIC, "time"), "SUB": (*_NUMERIC, "time"), "MUL": _NUMERIC,
          "DIV": _NUMERIC, "MOD": ("int", "uint", "literal"),
          **{op: ("bool", "bits") for op in LOGIC}}


def operand_type(op: str, left: ElementaryType, right: ElementaryType) -> ElementaryType | None:
    """Return the type in which an operator works on its operands, or None if they do not fit it."""
    if op in LOGIC and INT_LITERAL in (left, right) and BOOL in (left, right):
        return BOOL
    if op in ("MUL", "DIV") and left == TIME and right.kind in ("int", "uint", "literal") \
            and right is not REAL_LITERAL:
        return TIME
    common = common_type(left, right)
    if common is None or (op not in COMPARISON and common.kind not in _KINDS[op]):
        return None
    return common


def operation(op: str, of: ElementaryType) -> str:
    """Return the IR operation for an operator on a type."""
    return f"{ARITHMETIC.get(op) or LOGIC.get(op) or COMPARISON[op]}.{of.machine}"


class Expressions:
    """Infers and emits expressions into one function."""

    def __init__(self, emitter: Emitter) -> None:
        self._out = emitter
        self._types: dict[int, ElementaryType | None] = {}

    def infer(self, expr: s.Expr) -> ElementaryType | None:
        """Return an expression's type (perhaps a literal's), or None after a reported mistake."""
        if id(expr) not in self._types:
            self._types[id(expr)] = self._infer(expr)
        return self._types[id(expr)]

    def _infer(self, expr: s.Expr) -> ElementaryType | None:
        if isinstance(expr, s.Literal):
            return _literal_type(expr, self._out)
        if isinstance(expr, s.Name | s.Direct):
            found = self._out.value_place(expr)
            return found[1] if found else None
        if isinstance(expr, s.Evaluate):
            return BOOL
        if isinstance(expr, s.Unary):
            return self._infer_unary(expr)
        left, right = self.infer(expr.left), self.infer(expr.right)
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
        if of is None:
            return None
        fits = ("bool", "bits") if expr.op == "NOT" else ("int", "float", "time", "literal")
        if of.kind not in fits:
            self._out.report.error("P0023", expr.span, f"{expr.op} does not fit {of.name}")
            return None
        return of

    def emit(self, expr: s.Expr, target: ElementaryType) -> bool:
        """Push the value of an expression as a type; False after a reported mistake."""
        of = self.infer(expr)
        if of is None:
            return False
        constant = _folded(expr)
        if constant is not None:
            return self._emit_literal(constant, of, target)
        if of.kind == "literal":
            of = target
        elif not widens(of, target):
            self._out.report.error("P0023", expr.span, f"{of.name} where {target.name} is expected",
                                   _conversion_hint(of, target))
            return False
        self._emit_natural(expr, of)
        self.convert(of, target, expr.span)
        return not self._out.report.has_errors

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

    def _emit_literal(self, expr: s.Expr, of: ElementaryType, target: ElementaryType) -> bool:
        if of.kind != "literal" and not widens(of, target):
            self._out.report.error("P0023", expr.span, f"{of.name} where {target.name} is expected",
                                   _conversion_hint(of, target))
            return False
        value = constant_value(expr, target, self._out.report)
        if value is None:
            return False
        self._out.emit("const", (target.machine, value), expr.span)
        return True

    def _emit_natural(self, expr: s.Expr, of: ElementaryType) -> None:
        out = self._out
        if isinstance(expr, s.Name | s.Direct):
            found = out.value_place(expr)
            if found:
                out.load(found[0], found[1], expr.span)
        elif isinstance(expr, s.Evaluate):
            out.emit("addr", ("this", 0), expr.span)
            out.emit("call", expr.function, expr.span)
        elif isinstance(expr, s.Unary):
            self.emit(expr.operand, of)
            out.emit(f"{expr.op.lower()}.{of.machine}", None, expr.span)
        elif isinstance(expr, s.Binary):
            self._emit_binary(expr, of)

    def _emit_binary(self, expr: s.Binary, of: ElementaryType) -> None:
        left, right = self.infer(expr.left), self.infer(expr.right)
        assert left is not None and right is not None
        common = operand_type(expr.op, left, right)
        assert common is not None
        if common.kind == "literal":
            common = default_type(expr, common) if expr.op in COMPARISON else of
        second = LINT if common == TIME and right != TIME and expr.op in ("MUL", "DIV") else common
        if self.emit(expr.left, common) and self.emit(expr.right, second):
            self._out.emit(operation(expr.op, common), None, expr.span)


def default_type(expr: s.Expr, of: ElementaryType) -> ElementaryType:
    """Return the type a literal takes where nothing around it asks for one."""
    if of is REAL_LITERAL:
        return REAL
    if of is not INT_LITERAL:
        return of
    folded = _folded(expr)
    value = folded.value if isinstance(folded, s.Literal) else \
        folded.operand.value if isinstance(folded, s.Unary) and isinstance(folded.operand, s.Literal) \
        else 0
    size = abs(int(value))
    return INT if size < 1 << 15 else DINT if size < 1 << 31 else LINT


def _folded(expr: s.Expr) -> s.Literal | s.Unary | None:
    """Return the expression if it is a literal with at most a sign."""
    if isinstance(expr, s.Literal):
        return expr
    if isinstance(expr, s.Unary) and expr.op == "NEG" and isinstance(expr.operand, s.Literal):
        return expr
    return None


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
