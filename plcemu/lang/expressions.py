"""Expressions to IR: types are inferred from the leaves up, literals take the type around them."""

from __future__ import annotations

from dataclasses import replace

from plcemu.base.spans import Span
from plcemu.base.types import ELEMENTARY, ElementaryType, StringType
from plcemu.lang import functions
from plcemu.lang import syntax as s
from plcemu.lang.calls import Calls
from plcemu.lang.constants import constant_value
from plcemu.lang.emitter import Emitter
from plcemu.lang.operators import (
    COMPARISON,
    KINDS,
    LOGIC,
    NUMERIC,
    apply_operator,
    operand_type,
    result_type,
    second_type,
)
from plcemu.lang.types import (
    BOOL,
    DINT,
    INT,
    INT_LITERAL,
    LINT,
    REAL,
    REAL_LITERAL,
    TIME,
    BlockType,
    EnumType,
    Field,
    Place,
    Type,
    root,
    widens,
)

_CALL_KINDS = {**dict.fromkeys(LOGIC, ("bool", "bits")),
               **dict.fromkeys(("SEL", "MUX", "MAX", "MIN", "LIMIT", "MOVE"), (*NUMERIC, "bits"))}
"""The kinds of types that a call with nothing but literals may take from around it."""


class Expressions:
    """Infers and emits expressions into one function."""

    def __init__(self, emitter: Emitter) -> None:
        self._out = self.out = emitter
        self.report = emitter.report
        self._calls = Calls(self)
        self._types: dict[s.Expr, Type | None] = {}
        emitter.push_subscript = self._push_subscript

    # ------------------------------------------------------------ types

    def infer(self, expr: s.Expr) -> Type | None:
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

    def _infer_operand(self, expr: s.Expr) -> Type | None:
        if isinstance(expr, s.Literal):
            return _literal_type(expr, self._out)
        if isinstance(expr, s.Name) and self._member(expr) is not None:
            return self._member(expr)
        if isinstance(expr, s.Name | s.Direct):
            found = self._out.value_place(expr)
            return found[1] if found else None
        if isinstance(expr, s.Unary):
            return self._infer_unary(expr)
        if isinstance(expr, s.Call):
            return self._calls.infer(expr)
        return BOOL

    def _infer_binary(self, expr: s.Binary, left: Type | None) -> Type | None:
        right = self.infer(expr.right)
        if left is None or right is None:
            return None
        left, right = sized_literal(expr.left, left, right), sized_literal(expr.right, right, left)
        of = _operands(expr.op, left, right)
        if of is None:
            self._out.report.error("P0023", expr.span,
                                   f"{expr.op} does not fit {left.name} and {right.name}",
                                   _conversion_hint(left, right))
            return None
        return result_type(expr.op, of, right)

    def _infer_unary(self, expr: s.Unary) -> Type | None:
        of = self.infer(expr.operand)
        if of is INT_LITERAL and expr.op == "NOT":
            return of  # its bits are those of the type around it
        return of if of is not None and self._fits(expr, of) else None

    def _fits(self, expr: s.Unary | s.Binary, of: Type) -> bool:
        """Whether an operator works on a type; a mistake goes to the report."""
        if expr.op in COMPARISON or of.kind in KINDS[expr.op]:
            return True
        self._out.report.error("P0023", expr.span, f"{expr.op} does not fit {of.name}")
        return False

    # ------------------------------------------------------------ code

    def emit(self, expr: s.Expr, target: Type) -> bool:
        """Push the value of an expression as a type; False after a reported mistake."""
        # Operators lean to the left, so a long sum is a deep tree: go down it in a loop.
        chain: list[tuple[s.Binary, Type, Type, Type]] = []
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
            self._apply(binary, common)
            self.convert(of, wanted, binary.span)
        return good

    def _apply(self, binary: s.Binary, common: Type) -> None:
        right = self.infer(binary.right)
        if right is not None:
            apply_operator(self._out, binary.op, common, right, binary.span)

    def _member(self, expr: s.Name) -> EnumType | None:
        """Return the enumeration that a name is a value of, if no variable has the name."""
        if len(expr.parts) != 1 or self._out.scope.find(expr.head.upper()) is not None:
            return None
        found = self._out.scope.lookup(expr)
        return found[1] if found is not None and isinstance(found[1], EnumType) else None

    def _push_subscript(self, expr: s.Expr) -> None:
        of = self.infer(expr)
        if of is None:
            return
        if of.kind not in ("int", "uint", "literal") or of is REAL_LITERAL:
            self.report.error("P0023", expr.span, f"a subscript is an integer, not {of.name}")
            return
        natural = default_type(expr, of)
        if self.emit(expr, natural):
            self.convert(natural, LINT, expr.span)

    def _binary_types(self, expr: s.Binary,
                      target: Type) -> tuple[Type, Type] | None:
        """Return the types of a result and of the operands; None after a reported mistake."""
        of, left, right = self.infer(expr), self.infer(expr.left), self.infer(expr.right)
        if of is None or left is None or right is None:
            return None
        common = _operands(expr.op, sized_literal(expr.left, left, right),
                           sized_literal(expr.right, right, left))
        if of.kind == "literal" and not isinstance(target, ElementaryType):
            self._widens(expr, of, target)
            return None
        if of.kind == "literal":
            of = common = target
            if not self._takes_literal(expr, left, right, target):
                return None
        elif not self._widens(expr, of, target):
            return None
        if common is not None and common.kind == "literal":
            common = default_type(expr, common)
        return (of, common) if common is not None else None

    def _takes_literal(self, expr: s.Binary, left: Type, right: Type,
                       target: Type) -> bool:
        if expr.op in LOGIC:
            return self._fits(expr, target)
        if target.kind != "float" and REAL_LITERAL in (left, right):
            return self._widens(expr, REAL_LITERAL, target)
        return self._widens(expr, INT_LITERAL, target) if target.kind not in NUMERIC \
            else self._fits(expr, target)

    def _widens(self, expr: s.Expr, of: Type, target: Type) -> bool:
        if widens(of, target):
            return True
        self._out.report.error("P0023", expr.span, f"{of.name} where {target.name} is expected",
                               _conversion_hint(of, target))
        return False

    def _emit_operand(self, expr: s.Expr, target: Type) -> bool:
        of = self.infer(expr)
        if of is None:
            return False
        if _is_constant(expr) or (isinstance(expr, s.Name) and self._member(expr) is not None):
            return self._emit_constant(expr, of, target)
        if of.kind == "literal" and isinstance(expr, s.Call):
            takes = _CALL_KINDS.get(expr.name.upper(), NUMERIC)
            of = target if target.kind in takes else default_type(expr, of)
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

    def _emit_constant(self, expr: s.Expr, of: Type, target: Type) -> bool:
        if of.kind != "literal" and not self._widens(expr, of, target):
            return False
        if not isinstance(target, ElementaryType | StringType):
            return self._widens(expr, of, target)
        kept = of if isinstance(of, StringType) else target
        value = constant_value(expr, kept, self._out.report, self._out.scope.lookup)
        if value is None:
            return False
        if isinstance(kept, StringType):
            place = self._out.functions.allocate(kept.pack(value))
            self._out.emit("addr", ("memory", place), expr.span)
        else:
            self._out.emit("const", (target.machine, value), expr.span)
        return True

    def _emit_natural(self, expr: s.Expr, of: Type) -> bool:
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

    def push_variable(self, argument: s.Argument, field: Field) -> bool:
        """Push the address of the variable that a VAR_IN_OUT stands for."""
        assert field.target is not None
        if not isinstance(argument.value, s.Name | s.Direct):
            self.report.error("P0024", argument.span,
                              f"{field.name} is VAR_IN_OUT and takes a variable")
            return False
        place = self._out.place(argument.value)
        if place is None:
            return False
        if place.base == "local" or place.read_only or place.holder is not None:
            why = place.read_only or ("it is a bit" if place.holder else "it is VAR_TEMP")
            self.report.error("P0024", argument.span,
                              f"{place.name} cannot be VAR_IN_OUT: {why}")
            return False
        if not (widens(place.type, field.target) and widens(field.target, place.type)):
            self.report.error("P0023", argument.span, f"{field.name} is {field.target.name}, "
                              f"{place.name} is {place.type.name}")
            return False
        self._mark(argument.value, place, True)
        self._out.push_address(place, argument.span)
        return True

    def _mark(self, node: s.Name | s.Direct, place: Place, called: bool = False) -> None:
        """Remember that a variable is written, or handed to what may call it."""
        if isinstance(node, s.Name):
            self._out.scope.mark(node.head, called)
        else:
            self._out.scope.written.add((place.base, place.offset))

    def take_output(self, argument: s.Argument, place: Place, block: BlockType) -> None:
        """Put an output of the block at a place into the variable that an argument names."""
        field = block.fields.get(argument.name.upper())
        if field is None or field.section != "VAR_OUTPUT":
            known = [f.name for f in block.fields.values() if f.section == "VAR_OUTPUT"]
            self.report.error("P0026", argument.span, f"{block.name} has no output "
                              f"{argument.name!r}", f"its outputs are {', '.join(known)}")
            return
        if not isinstance(argument.value, s.Name | s.Direct):
            self.report.error("P0024", argument.value.span, "an output goes into a variable")
            return
        target = self.writable(argument.value)
        if target is None:
            return
        if argument.negated and field.type.kind not in ("bool", "bits"):
            self.report.error("P0023", argument.span, f"NOT does not fit {field.type.name}")
            return
        if not widens(field.type, target[1]):
            self.report.error("P0023", argument.span, f"output {field.name} is "
                              f"{field.type.name}, {target[0].name} is {target[1].name}")
            return
        source = replace(place, offset=place.offset + field.offset, type=field.type)
        self._out.load(source, root(field.type), argument.span)
        if argument.negated:
            self._out.emit(f"not.{field.type.machine}", None, argument.span)
        self.convert(field.type, target[1], argument.span)
        self._out.store(target[0], target[1], argument.span)

    def writable(self, node: s.Name | s.Direct,
                 of_chart: bool = False) -> tuple[Place, Type] | None:
        """Return the place of a variable that may be written; a mistake goes to the report."""
        found = self._out.value_place(node)
        if found and found[0].read_only and not of_chart:
            self.report.error("P0024", node.span,
                              f"{found[0].name} cannot be written: {found[0].read_only}")
            return None
        if found:
            self._mark(node, found[0])
        return found

    def emit_natural(self, expr: s.Expr) -> Type | None:
        """Push the value of an expression in its own type and return it."""
        of = self.infer(expr)
        if of is None:
            return None
        of = default_type(expr, of)
        return of if self.emit(expr, of) else None

    def convert(self, source: Type, target: Type, span: Span) -> None:
        """Convert the value on the stack."""
        if source.machine != target.machine:
            self._out.emit(f"to.{source.machine}.{target.machine}", None, span)


def _operands(op: str, left: Type, right: Type) -> Type | None:
    """Return the type in which an operator works; on bits of literals it is the one around it."""
    if op in LOGIC and left is INT_LITERAL and right is INT_LITERAL:
        return INT_LITERAL
    return operand_type(op, left, right)


def default_type(expr: s.Expr, of: Type) -> Type:
    """Return the type that literals take where nothing around them asks for one."""
    if of is REAL_LITERAL:
        return REAL
    if of is not INT_LITERAL:
        return of
    low, high = _literal_range(expr)
    return next((row for row in (INT, DINT) if row.low <= low and high <= row.high), LINT)


def sized_literal(expr: s.Expr, of: Type, other: Type) -> Type:
    """Return the type of an operand: an integer literal beyond the other's range has its own."""
    other = root(other)
    if of is not INT_LITERAL or isinstance(expr, s.Call) \
            or not isinstance(other, ElementaryType) or other.kind not in ("int", "uint"):
        return of  # a function such as TRUNC gives what is asked of it
    low, high = _literal_range(expr)
    return of if other.low <= low and high <= other.high else default_type(expr, of)


def _literal_range(expr: s.Expr) -> tuple[int, int]:
    """Return the smallest and the largest of the integer literals in an expression, and 0."""
    low, high, pending = 0, 0, [expr]
    while pending:
        each = pending.pop()
        if isinstance(each, s.Binary):
            pending += [each.left, each.right]
        elif isinstance(each, s.Literal):
            high = max(high, each.value if isinstance(each.value, int) else 0)
        elif isinstance(each, s.Unary) and isinstance(each.operand, s.Literal):
            low = min(low, -each.operand.value if isinstance(each.operand.value, int) else 0)
        elif isinstance(each, s.Unary):
            pending.append(each.operand)
        elif isinstance(each, s.Call):
            row = functions.find(each.name)
            if row is not None and row.natural is not None:
                low, high = min(low, row.natural.low), max(high, row.natural.high)
            else:
                pending += [argument.value for argument in each.arguments]
    return low, high


def _is_constant(expr: s.Expr) -> bool:
    """Whether the expression is a literal with at most a sign."""
    if isinstance(expr, s.Unary) and expr.op == "NEG":
        expr = expr.operand
    return isinstance(expr, s.Literal)


def _literal_type(expr: s.Literal, out: Emitter) -> Type | None:
    if expr.kind == "string" and expr.type.endswith("#"):
        found = out.scope.lookup(expr)
        if found is None:
            out.report.error("P0020", expr.span, f"there is no {expr.type}{expr.value}")
            return None
        return found[1]
    if expr.kind == "string":
        units = len(str(expr.value).encode("utf-16-le", "surrogatepass")) // 2
        return StringType(max(1, units), expr.type == "WSTRING")
    if expr.kind in ("time", "date", "tod", "dt"):
        return TIME if expr.kind == "time" else ELEMENTARY[_DATE_TYPES[expr.kind]]
    if expr.type:
        return ELEMENTARY[expr.type]
    return {"int": INT_LITERAL, "real": REAL_LITERAL, "bool": BOOL}[expr.kind]


_DATE_TYPES = {"date": "DATE", "tod": "TIME_OF_DAY", "dt": "DATE_AND_TIME"}


def _conversion_hint(source: Type, target: Type) -> str:
    if "literal" in (source.kind, target.kind) or source == target:
        return ""
    if source.kind in ("int", "uint", "float", "bits") and target.kind in ("int", "uint", "float"):
        return "this would lose information"
    return ""
