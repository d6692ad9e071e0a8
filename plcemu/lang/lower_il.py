"""Instruction List to IR.

The current result is kept where it costs least: as a literal not yet emitted, on the stack, or in
a local variable. It moves to a local only when more than one instruction needs it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from plcemu.base.spans import Span
from plcemu.base.types import ElementaryType
from plcemu.lang import syntax as s
from plcemu.lang.emitter import Emitter
from plcemu.lang.expressions import COMPARISON, LOGIC, Expressions, default_type, operand_type, operation
from plcemu.lang.lower_st import Statements
from plcemu.lang.types import BOOL, LINT, TIME, Place


@dataclass(slots=True)
class _Result:
    """The current result: `none`, `literal`, `stack` or `local`."""

    where: str = "none"
    type: ElementaryType = BOOL
    literal: s.Expr | None = None
    local: int = -1


class InstructionList:
    """Lowers one IL body into one function."""

    def __init__(self, emitter: Emitter) -> None:
        self._out = emitter
        self._statements = Statements(emitter)
        self._expressions: Expressions = self._statements.expressions
        self._result = _Result()
        self._labels: dict[str, int] = {}
        self._at_label: dict[str, ElementaryType] = {}
        self._spills: dict[tuple[int, str], int] = {}
        self._depth = 0
        self._needs_at: dict[str, bool] = {}

    def lower(self, body: s.IlBody) -> None:
        """Append the code of a body, without the final return."""
        self._declare_labels(body.instructions)
        wanted = bool(self._out.result)
        self._sequence(body.instructions, wanted)
        if wanted:
            self._require_bool(body.span)
            self._to_stack(body.span)
        elif self._result.where == "stack":
            self._out.emit("drop", None, body.span)

    def _declare_labels(self, instructions: Sequence[s.Instruction]) -> None:
        for n, each in enumerate(instructions):
            key = each.label.upper()
            if key in self._labels:
                self._out.report.error("P0041", each.span, f"label {each.label!r} stands twice")
            elif key:
                self._labels[key] = self._out.new_label()
                self._needs_at[key] = _needs_result(instructions[n:], bool(self._out.result))

    def _sequence(self, instructions: Sequence[s.Instruction], wanted: bool) -> None:
        for n, each in enumerate(instructions):
            needed = _needs_result(instructions[n + 1:n + 3], wanted)
            if each.label:
                self._label(each, _needs_result(instructions[n:n + 3], wanted))
            if each.op:
                self._instruction(each, needed)

    # ------------------------------------------------------------ the current result

    def _forget(self, span: Span) -> None:
        if self._result.where == "stack":
            self._out.emit("drop", None, span)
        self._result = _Result()

    def _to_stack(self, span: Span, target: ElementaryType | None = None) -> ElementaryType | None:
        """Push the current result, perhaps widened; None after a reported mistake."""
        result = self._result
        if result.where == "none":
            self._out.report.error("P0042", span, "there is no current result here; LD comes first")
            return None
        of = result.type
        if result.where == "literal":
            assert result.literal is not None
            of = target or default_type(result.literal, of)
            if not self._expressions.emit(result.literal, of):
                return None
        elif result.where == "local":
            self._out.emit("get", result.local, span)
        if target is not None and of != target:
            self._expressions.convert(of, target, span)
            of = target
        self._result = _Result("stack", of)
        return of

    def _to_local(self, span: Span) -> ElementaryType | None:
        """Move the current result to a local, from where it can be taken more than once."""
        if self._result.where == "local":
            return self._result.type
        of = self._to_stack(span)
        if of is None:
            return None
        key = (self._depth, of.machine)
        if key not in self._spills:
            self._spills[key] = self._out.new_local(of.machine)
        self._out.emit("set", self._spills[key], span)
        self._result = _Result("local", of, None, self._spills[key])
        return of

    def _taken(self, needed: bool, span: Span) -> ElementaryType | None:
        """Push the current result for one use, keeping it for later ones if they need it."""
        if not needed:
            of = self._to_stack(span)
            self._result = _Result()
            return of
        if self._result.where == "literal":
            kept = self._result
            of = self._to_stack(span)
            self._result = kept
            return of
        of = self._to_local(span)
        if of is not None:
            self._out.emit("get", self._result.local, span)
        return of

    def _require_bool(self, span: Span) -> bool:
        if self._result.where == "literal" and self._result.literal is not None:
            self._result.type = BOOL if self._result.type.kind == "literal" else self._result.type
        if self._result.where != "none" and self._result.type != BOOL:
            self._out.report.error("P0023", span,
                                   f"a BOOL is needed here, the current result is "
                                   f"{self._result.type.name}")
            return False
        return True

    # ------------------------------------------------------------ labels and jumps

    def _label(self, instruction: s.Instruction, needed: bool) -> None:
        key, span = instruction.label.upper(), instruction.span
        falls_through = self._result.where != "none"
        if needed and falls_through:
            self._join(key, span)
        elif falls_through:
            self._forget(span)
        self._out.emit("label", self._labels[key], span)
        if needed and key in self._at_label:
            of = self._at_label[key]
            self._result = _Result("local", of, None, self._spills[(self._depth, of.machine)])

    def _join(self, key: str, span: Span) -> None:
        """Bring the current result to where the code after a label expects it."""
        of = self._to_local(span)
        if of is None:
            return
        known = self._at_label.setdefault(key, of)
        if known != of:
            self._out.report.error("P0042", span, f"the current result is {of.name} here and "
                                   f"{known.name} on another way to the same label")

    def _jump(self, each: s.Instruction, needed: bool) -> None:
        assert isinstance(each.operand, s.Name)
        key = each.operand.parts[0].upper()
        if key not in self._labels:
            self._out.report.error("P0040", each.operand.span,
                                   f"there is no label {each.operand.parts[0]!r}")
            return
        if self._depth:
            self._out.report.error("P0013", each.span, "no jump can leave a parenthesis")
            return
        if self._needs_at[key]:
            self._join(key, each.span)
        if not each.conditional:
            self._forget(each.span)
            self._out.emit("jump", self._labels[key], each.span)
            return
        if self._require_bool(each.span) and self._taken(needed or self._needs_at[key], each.span):
            self._out.emit("jumpifnot" if each.negated else "jumpif", self._labels[key], each.span)

    def _guarded(self, each: s.Instruction, needed: bool) -> int:
        """Begin what a C or CN modifier guards; return the label behind it."""
        skip = self._out.new_label()
        if self._require_bool(each.span) and self._taken(needed, each.span):
            self._out.emit("jumpif" if each.negated else "jumpifnot", skip, each.span)
        return skip

    # ------------------------------------------------------------ instructions

    def _instruction(self, each: s.Instruction, needed: bool) -> None:
        if each.op == "LD":
            self._load(each)
        elif each.op in ("ST", "S", "R"):
            self._store(each, needed)
        elif each.op == "JMP":
            self._jump(each, needed)
        elif each.op == "CAL":
            self._call(each, needed)
        elif each.op == "RET":
            self._return(each, needed)
        elif each.op == "NOT":
            self._not(each)
        else:
            self._operator(each)

    def _load(self, each: s.Instruction) -> None:
        assert each.operand is not None
        self._forget(each.span)
        of = self._expressions.infer(each.operand)
        if of is None:
            self._result = _Result("literal", BOOL, s.Literal(each.span, "bool", False))
        elif isinstance(each.operand, s.Literal | s.Unary):
            self._result = _Result("literal", of, each.operand)
        elif self._expressions.emit(each.operand, of):
            self._result = _Result("stack", of)
        else:
            self._result = _Result("literal", of, s.Literal(each.span, "bool", False))
        if each.negated:
            self._not(each)

    def _not(self, each: s.Instruction) -> None:
        if self._result.type.kind == "literal":
            self._require_bool(each.span)
        of = self._to_stack(each.span, BOOL if self._result.where == "literal"
                            and self._result.type == BOOL else None)
        if of is None:
            return
        if of.kind not in ("bool", "bits"):
            self._out.report.error("P0023", each.span, f"NOT does not fit {of.name}")
            return
        self._out.emit(f"not.{of.machine}", None, each.span)

    def _store(self, each: s.Instruction, needed: bool) -> None:
        assert isinstance(each.operand, s.Name | s.Direct)
        found = self._statements.writable(each.operand)
        if found is None:
            return
        place, of = found
        if each.op == "ST":
            self._plain_store(each, place, of, needed)
            return
        if of != BOOL:
            self._out.report.error("P0023", each.span, f"{each.op} sets a BOOL, not {of.name}")
            return
        if not self._require_bool(each.span) or self._taken(needed, each.span) is None:
            return
        if each.op == "R":
            self._out.emit("not.bool", None, each.span)
        self._out.load(place, of, each.span)
        self._out.emit("or.bool" if each.op == "S" else "and.bool", None, each.span)
        self._out.store(place, of, each.span)

    def _plain_store(self, each: s.Instruction, place: Place, of: ElementaryType,
                     needed: bool) -> None:
        result = self._result
        if result.where == "literal" and result.literal is not None:
            if not self._expressions.emit(result.literal, of):
                return
        else:
            held = self._taken(needed, each.span)
            if held is None:
                return
            if operand_type("EQ", held, of) != of:
                self._out.report.error("P0023", each.span, f"the current result is {held.name}, "
                                       f"{place.name} is {of.name}")
                return
            self._expressions.convert(held, of, each.span)
        if each.negated:
            if of.kind not in ("bool", "bits"):
                self._out.report.error("P0023", each.span, f"STN does not fit {of.name}")
            self._out.emit(f"not.{of.machine}", None, each.span)
        self._out.store(place, of, each.span)

    def _call(self, each: s.Instruction, needed: bool) -> None:
        assert isinstance(each.operand, s.Name)
        if self._depth:
            self._out.report.error("P0013", each.span, "no CAL can stand in a parenthesis")
            return
        skip = self._guarded(each, needed) if each.conditional else None
        if needed and self._result.where == "stack":
            self._to_local(each.span)
        elif not needed:
            self._forget(each.span)
        self._statements.invoke(s.Invoke(each.span, each.operand, each.arguments))
        if skip is not None:
            self._out.emit("label", skip, each.span)

    def _return(self, each: s.Instruction, needed: bool) -> None:
        wanted = bool(self._out.result)
        skip = self._guarded(each, needed or wanted) if each.conditional else self._out.new_label()
        if wanted and self._taken(True, each.span) is None:
            return
        if not wanted and not needed:
            self._forget(each.span)
        self._out.emit("ret", None, each.span)
        self._out.emit("label", skip, each.span)
        if not each.conditional:
            self._result = _Result()

    # ------------------------------------------------------------ operators

    def _operator(self, each: s.Instruction) -> None:
        op = "AND" if each.op == "&" else each.op
        if each.nested is not None:
            self._parenthesis(each, op)
            return
        assert each.operand is not None
        right = self._expressions.infer(each.operand)
        if right is None or not self._has_result(each):
            return
        common = self._common(op, self._result.type, right, each)
        if common is None or self._to_stack(each.span, common) is None:
            return
        second = LINT if common == TIME and right != TIME and op in ("MUL", "DIV") else common
        if self._expressions.emit(each.operand, second):
            self._apply(each, op, common)

    def _has_result(self, each: s.Instruction) -> bool:
        if self._result.where == "none":
            self._out.report.error("P0042", each.span,
                                   f"there is no current result for {each.op}; LD comes first")
        return self._result.where != "none"

    def _common(self, op: str, left: ElementaryType, right: ElementaryType,
                each: s.Instruction) -> ElementaryType | None:
        common = operand_type(op, left, right)
        if common is None:
            self._out.report.error("P0023", each.span, f"{each.op} does not fit {left.name} and "
                                   f"{right.name}")
            return None
        if common.kind == "literal":
            return default_type(each.operand or s.Literal(each.span, "int", 0), common)
        return common

    def _apply(self, each: s.Instruction, op: str, common: ElementaryType) -> None:
        if each.negated:
            if op not in LOGIC or common.kind not in ("bool", "bits"):
                self._out.report.error("P0013", each.span, f"{each.op}N does not fit {common.name}")
                return
            self._out.emit(f"not.{common.machine}", None, each.span)
        self._out.emit(operation(op, common), None, each.span)
        self._result = _Result("stack", BOOL if op in COMPARISON else common)

    def _parenthesis(self, each: s.Instruction, op: str) -> None:
        """Defer an operator: its operand is what the nested instructions leave (table 51)."""
        assert each.nested is not None
        if not self._has_result(each) or self._to_stack(each.span) is None:
            return
        left = self._result.type
        self._depth += 1
        self._result = _Result()
        self._sequence(each.nested, True)
        right = self._to_stack(each.span, left if self._result.type.kind == "literal" else None)
        self._depth -= 1
        if right is None:
            self._result = _Result("stack", left)
            return
        common = self._common(op, left, right, each)
        if common is None:
            return
        if common != right:
            self._expressions.convert(right, common, each.span)
        if common != left:
            kept = self._out.new_local(common.machine)
            self._out.emit("set", kept, each.span)
            self._expressions.convert(left, common, each.span)
            self._out.emit("get", kept, each.span)
        self._apply(each, op, common)


def _needs_result(instructions: Sequence[s.Instruction], wanted: bool) -> bool:
    """Whether what follows takes the current result before it loads another."""
    for each in instructions:
        if each.op == "LD":
            return False
        if each.op == "CAL" and not each.conditional:
            continue
        if each.op:
            return True
    return wanted if not instructions or len(instructions) < 2 else True
