"""Instruction List to IR, block by block.

The current result is kept where it costs least: as a literal not yet emitted, on the stack, or in
a local variable. It moves to a local only when more than one instruction takes it, or when it is
wanted behind a label, where the IR's stack is empty.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from plcemu.base.spans import Span
from plcemu.base.types import ElementaryType, StringType
from plcemu.ir.program import Instr
from plcemu.lang import syntax as s
from plcemu.lang.emitter import Emitter
from plcemu.lang.expressions import Expressions, default_type
from plcemu.lang.gates import Gate, gated
from plcemu.lang.il import input_operator
from plcemu.lang.il_flow import find_blocks, find_labels, find_wanted, is_jump
from plcemu.lang.lower_st import Statements
from plcemu.lang.operators import apply_operator, operand_type, result_type, second_type
from plcemu.lang.types import BOOL, BlockType, Place, Type, widens


@dataclass(slots=True)
class _Result:
    """The current result.

    Attributes:
        where: `none`, `unknown` (after a reported mistake), `literal`, `stack` or `local`.
        type: its type; of a literal without one perhaps that of literals.
        literal: the expression, of a literal.
        local: the number, of a local.
    """

    where: str = "none"
    type: Type = BOOL
    literal: s.Expr | None = None
    local: int = -1


class InstructionList:
    """Lowers one IL body into one function."""

    def __init__(self, emitter: Emitter) -> None:
        self._out = emitter
        self._statements = Statements(emitter)
        self._expressions: Expressions = self._statements.expressions
        self._result = _Result()
        self._spills: dict[tuple[int, str], int] = {}
        self._depth = 0
        self._labels: dict[str, int] = {}
        self._marks: dict[int, int] = {}
        self._wanted: list[bool] = []
        self._entries: dict[int, _Result] = {}

    # ------------------------------------------------------------ blocks

    def lower(self, body: s.IlBody) -> None:
        """Append the code of a body, without the final return."""
        instructions = [self._operator_of_input(each) for each in body.instructions]
        self._labels = find_labels(instructions)
        self._wanted = find_wanted(instructions, self._labels, bool(self._out.result))
        self._report_doubles(instructions)
        self._marks = {n: self._out.new_label() for n in sorted(self._labels.values())}
        blocks = dict(find_blocks(instructions))
        self._entries = {0: _Result()}
        pieces: dict[int, list[Instr]] = {}
        while waiting := [begin for begin in self._entries if begin not in pieces]:
            begin = min(waiting)
            pieces[begin] = self._block(instructions, begin, blocks[begin], body.span)
        for begin in sorted(blocks.keys() - pieces.keys()):
            # Nothing leads here: it is looked through for mistakes, but leaves no code.
            self._entries[begin] = _Result("unknown")
            self._block(instructions, begin, blocks[begin], body.span)
        for begin in sorted(pieces):
            self._out.code.extend(pieces[begin])

    def _report_doubles(self, instructions: Sequence[s.Instruction]) -> None:
        for n, each in enumerate(instructions):
            if each.label and self._labels[each.label.upper()] != n:
                self._out.report.error("P0041", each.span, f"label {each.label!r} stands twice")

    def _block(self, instructions: Sequence[s.Instruction], begin: int, end: int,
               span: Span) -> list[Instr]:
        """Return the code of a block; it tells the blocks that follow it what comes in."""
        before = len(self._out.code)
        self._result = self._entries[begin]
        if begin in self._marks:
            self._out.emit("label", self._marks[begin], instructions[begin].span)
        for n in range(begin, end):
            if instructions[n].op:
                self._instruction(instructions[n], self._wanted[n + 1])
        if begin == end:
            self._leave_block(end, end, span)
        elif not is_jump(instructions[end - 1]):
            self._leave_block(end, len(instructions), instructions[end - 1].span)
        code = self._out.code[before:]
        del self._out.code[before:]
        return code

    def _leave_block(self, following: int, end: int, span: Span) -> None:
        if following < end:
            self._enter_from(following, span)
            self._forget(span)
        elif self._out.result:
            self._push_value(span)
        else:
            self._forget(span)

    def _enter_from(self, target: int, span: Span) -> None:
        """Tell the block that begins at `target` in which local the current result will come."""
        came = _Result(self._result.where)
        if self._wanted[target] and came.where != "none":
            of = self._to_local(span)
            came = _Result("unknown") if of is None else \
                _Result("local", of, None, self._spills[(0, of.machine)])
        known = self._entries.setdefault(target, came if self._wanted[target] else _Result())
        if known.where != "local":
            return
        if came.where == "none":
            self._out.report.error("P0042", span, "there is no current result here, but it is "
                                   "wanted behind the label")
        elif came.where == "local" and known.type != came.type:
            self._out.report.error("P0023", span, f"the current result is {came.type.name} here "
                                   f"and {known.type.name} on another way to the same label")

    # ------------------------------------------------------------ the current result

    def _forget(self, span: Span) -> None:
        if self._result.where == "stack":
            self._out.emit("drop", None, span)
        self._result = _Result()

    def _fail(self) -> None:
        """Go on without a current result after a reported mistake."""
        self._result = _Result("unknown")

    def _is_there(self, span: Span) -> bool:
        """Whether there is a current result; if there should be one, the report says so."""
        if self._result.where == "none":
            self._out.report.error("P0042", span, "there is no current result here; LD comes first")
            self._fail()
        return self._result.where != "unknown"

    def _to_stack(self, span: Span, target: Type | None = None) -> Type | None:
        """Push the current result, perhaps widened; None after a reported mistake."""
        if not self._is_there(span):
            return None
        result, of = self._result, self._result.type
        if result.where == "literal":
            assert result.literal is not None
            of = target or default_type(result.literal, of)
            if not self._expressions.emit(result.literal, of):
                self._fail()
                return None
        elif result.where == "local":
            self._out.emit("get", result.local, span)
        if target is not None and of != target:
            self._expressions.convert(of, target, span)
            of = target
        self._result = _Result("stack", of)
        return of

    def _to_local(self, span: Span) -> Type | None:
        """Move the current result to a local, from where it can be taken more than once."""
        if self._result.where == "local":
            return self._result.type
        of = self._to_stack(span)
        if of is None:
            return None
        self._result = _Result("local", of, None, self._spill(of))
        self._out.emit("set", self._result.local, span)
        return of

    def _spill(self, of: Type) -> int:
        """Return the local in which the current result is kept at this depth of parentheses."""
        key = (self._depth, of.machine)
        if key not in self._spills:
            self._spills[key] = self._out.new_local(of.machine)
        return self._spills[key]

    def _taken(self, wanted: bool, span: Span) -> Type | None:
        """Push the current result for one use, keeping it if it is wanted later."""
        kept = self._result
        if not wanted or kept.where in ("none", "unknown"):
            of = self._to_stack(span)
            if of is not None:
                self._result = _Result()
            return of
        if kept.where == "literal":
            of = self._to_stack(span)
            if of is not None:
                self._result = kept
            return of
        of = self._to_local(span)
        if of is not None:
            self._out.emit("get", self._result.local, span)
        return of

    def _is_bool(self, span: Span) -> bool:
        """Whether the current result is a BOOL; a mistake goes to the report."""
        if not self._is_there(span):
            return False
        if self._result.type.kind == "literal":
            self._result.type = BOOL
        if self._result.type == BOOL:
            return True
        self._out.report.error("P0023", span, f"a BOOL is needed here, the current result is "
                               f"{self._result.type.name}")
        self._fail()
        return False

    # ------------------------------------------------------------ jumps and calls

    def _jump(self, each: s.Instruction, wanted: bool) -> None:
        assert isinstance(each.operand, s.Name)
        target = self._labels.get(each.operand.head.upper())
        if target is None:
            self._out.report.error("P0040", each.operand.span,
                                   f"there is no label {each.operand.head!r}")
        elif not each.conditional:
            self._enter_from(target, each.span)
            self._forget(each.span)
            self._out.emit("jump", self._marks[target], each.span)
        elif self._is_bool(each.span):
            self._enter_from(target, each.span)
            self._taken(wanted, each.span)
            op = "jumpifnot" if each.negated else "jumpif"
            self._out.emit(op, self._marks[target], each.span)
        else:
            self._entries.setdefault(target, _Result("unknown"))

    def _guarded(self, each: s.Instruction, wanted: bool) -> int:
        """Begin what a C or CN modifier guards; return the label behind it."""
        skip = self._out.new_label()
        if self._is_bool(each.span) and self._taken(wanted, each.span):
            self._out.emit("jumpif" if each.negated else "jumpifnot", skip, each.span)
        return skip

    def _call(self, each: s.Instruction, wanted: bool) -> None:
        assert isinstance(each.operand, s.Name)
        skip = self._guarded(each, wanted) if each.conditional else None
        if not wanted:
            self._forget(each.span)
        elif self._result.where == "stack":
            self._to_local(each.span)
        self._statements.invoke(s.Invoke(each.span, each.operand, self._arguments(each)))
        if skip is not None:
            self._out.emit("label", skip, each.span)

    def _operator_of_input(self, each: s.Instruction) -> s.Instruction:
        """Take LD, S and R for inputs if their operand is a function block instance (table 54)."""
        if each.op not in ("LD", "S", "R") or each.negated or not isinstance(each.operand, s.Name):
            return each
        head = self._out.scope.find(each.operand.head.upper())
        if head is None or isinstance(head.type, ElementaryType | StringType):
            return each
        place = self._out.place(each.operand)
        is_block = place is not None and isinstance(place.type, BlockType) \
            and place.type.kind == "FUNCTION_BLOCK"
        return input_operator(each, each.operand) if is_block else each

    def _input(self, each: s.Instruction, wanted: bool) -> None:
        """Give the current result to an input and call the function block (table 53, feature 3)."""
        assert isinstance(each.operand, s.Name)
        value = self._as_operand(each.span)
        if value is not None:
            name = each.arguments[0].name
            argument = s.Argument(each.span, name, value)
            self._statements.invoke(s.Invoke(each.span, each.operand, (argument,)))

    # ------------------------------------------------------------ functions

    def _function(self, each: s.Instruction) -> None:
        """Call a function; its value is the new current result (table 53)."""
        assert isinstance(each.operand, s.Name)
        first: tuple[s.Argument, ...] = ()
        if each.op == "FUNCTION":
            value = self._as_operand(each.span)
            if value is None:
                return
            first = (s.Argument(value.span, "", value),)
        else:
            self._forget(each.span)
        call = s.Call(each.span, each.operand.head, first + self._arguments(each))
        gate, call = self._statements.ungated(call)
        if gate:
            self._gated(call, gate)
            return
        of = self._expressions.emit_natural(call)
        self._result = _Result("unknown") if of is None else _Result("stack", of)

    def _gated(self, call: s.Call, gate: Gate) -> None:
        """Call a function with EN and ENO; while EN is FALSE the current result is 0."""
        of = self._expressions.infer(call)
        if of is None or self._depth or not isinstance(of, ElementaryType):
            if of is not None:
                self._out.report.error("P0090", call.span, "EN and ENO are not supported here yet")
            self._fail()
            return
        of = default_type(call, of)
        local = self._spill(of)
        self._out.emit("const", (of.machine, 0), call.span)
        self._out.emit("set", local, call.span)
        with gated(self._statements, gate):
            if self._expressions.emit(call, of):
                self._out.emit("set", local, call.span)
        self._result = _Result("local", of, None, local)

    def _as_operand(self, span: Span) -> s.Expr | None:
        """Return the current result as an operand of an expression; None after a mistake."""
        if not self._is_there(span):
            return None
        if self._result.where == "literal":
            return self._result.literal
        of = self._to_local(span)
        return None if of is None else self._named(self._result.local, of, span)

    def _named(self, local: int, of: Type, span: Span) -> s.Name:
        name = f"the current result {local}"
        self._out.name_local(name, local, of)
        return s.Name(span, (name,))

    def _arguments(self, each: s.Instruction) -> tuple[s.Argument, ...]:
        """Return a call's arguments, those in the form of instructions put into locals first."""
        return tuple(replace(a, value=self._nested_argument(a.value))
                     if isinstance(a.value, s.Nested) else a for a in each.arguments)

    def _nested_argument(self, value: s.Nested) -> s.Expr:
        kept = self._result
        of = self._nested(s.Instruction(value.span, "", "", nested=value.instructions), None)
        self._result = kept
        local = self._out.new_local((of or BOOL).machine)
        if of is not None:
            self._out.emit("set", local, value.span)
        return self._named(local, of or BOOL, value.span)

    def _return(self, each: s.Instruction, wanted: bool) -> None:
        has_value = bool(self._out.result)
        skip = self._guarded(each, wanted or has_value) if each.conditional else None
        kept = self._result
        if has_value:
            self._push_value(each.span)
        elif skip is None:
            self._forget(each.span)
        self._out.emit("ret", None, each.span)
        self._result = _Result()
        if skip is not None:
            self._out.emit("label", skip, each.span)
            self._result = kept

    def _push_value(self, span: Span) -> None:
        if self._is_bool(span):
            self._to_stack(span)

    # ------------------------------------------------------------ instructions

    def _instruction(self, each: s.Instruction, wanted: bool) -> None:
        if each.op == "LD":
            self._load(each)
        elif each.op in ("ST", "S", "R"):
            self._store(each, wanted)
        elif each.op in ("JMP", "CAL", "RET", "INPUT"):
            if self._depth:
                op = each.arguments[0].name if each.op == "INPUT" else each.op
                self._out.report.error("P0013", each.span, f"no {op} can stand in a parenthesis")
                self._fail()
                return
            {"JMP": self._jump, "CAL": self._call, "RET": self._return,
             "INPUT": self._input}[each.op](each, wanted)
        elif each.op in ("FUNCTION", "FUNCTION("):
            self._function(each)
        elif each.op == "NOT":
            self._not(each)
        elif each.nested is not None:
            self._parenthesis(each)
        else:
            self._operator(each)

    def _load(self, each: s.Instruction) -> None:
        assert each.operand is not None
        self._forget(each.span)
        of = self._expressions.infer(each.operand)
        if of is None:
            self._fail()
        elif isinstance(each.operand, s.Literal | s.Unary):
            self._result = _Result("literal", of, each.operand)
        elif self._expressions.emit(each.operand, of):
            self._result = _Result("stack", of)
        if each.negated:
            self._not(each)

    def _not(self, each: s.Instruction) -> None:
        if self._result.type.kind == "literal" and not self._is_bool(each.span):
            return
        is_bool = self._result.where == "literal" and self._result.type == BOOL
        of = self._to_stack(each.span, BOOL if is_bool else None)
        if of is None:
            return
        if of.kind in ("bool", "bits"):
            self._out.emit(f"not.{of.machine}", None, each.span)
        else:
            self._out.report.error("P0023", each.span, f"NOT does not fit {of.name}")
            self._fail()

    def _store(self, each: s.Instruction, wanted: bool) -> None:
        assert isinstance(each.operand, s.Name | s.Direct)
        found = self._statements.writable(each.operand)
        there = self._is_there(each.span)
        if found is None:
            return
        place, of = found
        if each.op != "ST" and of != BOOL:
            self._out.report.error("P0023", each.span, f"{each.op} sets a BOOL, not {of.name}")
        elif not there:
            return
        elif each.op == "ST":
            self._plain_store(each, place, of, wanted)
        elif self._is_bool(each.span) and self._taken(wanted, each.span):
            if each.op == "R":
                self._out.emit("not.bool", None, each.span)
            self._out.load(place, of, each.span)
            self._out.emit("or.bool" if each.op == "S" else "and.bool", None, each.span)
            self._out.store(place, of, each.span)

    def _plain_store(self, each: s.Instruction, place: Place, of: Type,
                     wanted: bool) -> None:
        if self._result.where == "literal":
            assert self._result.literal is not None
            if not self._expressions.emit(self._result.literal, of):
                return
        else:
            held = self._result.type
            if not widens(held, of):
                self._out.report.error("P0023", each.span, f"the current result is {held.name}, "
                                       f"{place.name} is {of.name}")
                return
            self._taken(wanted, each.span)
            self._expressions.convert(held, of, each.span)
        if each.negated:
            if of.kind not in ("bool", "bits"):
                self._out.report.error("P0023", each.span, f"STN does not fit {of.name}")
            self._out.emit(f"not.{of.machine}", None, each.span)
        self._out.store(place, of, each.span)

    # ------------------------------------------------------------ operators

    def _operator(self, each: s.Instruction) -> None:
        assert each.operand is not None
        op = _plain(each)
        right = self._expressions.infer(each.operand)
        if not self._is_there(each.span):
            return
        common = None if right is None else self._common(each, self._result.type, right)
        if right is None or common is None:
            self._fail()
        elif self._to_stack(each.span, common) is not None:
            if self._expressions.emit(each.operand, second_type(op, common, right)):
                self._apply(each, common, right)
            else:
                self._fail()

    def _common(self, each: s.Instruction, left: Type,
                right: Type) -> Type | None:
        """Return the type in which an operator works; None after a reported mistake."""
        common = operand_type(_plain(each), left, right)
        if common is None:
            self._out.report.error("P0023", each.span, f"{each.op} does not fit {left.name} and "
                                   f"{right.name}")
        elif common.kind == "literal":
            literals = [x for x in (self._result.literal, each.operand) if x is not None]
            return max((default_type(x, common) for x in literals), key=lambda of: of.size)
        return common

    def _apply(self, each: s.Instruction, common: Type, right: Type) -> None:
        op = _plain(each)
        if each.negated:
            self._out.emit(f"not.{common.machine}", None, each.span)
        apply_operator(self._out, op, common, right, each.span)
        self._result = _Result("stack", result_type(op, common, right))

    def _parenthesis(self, each: s.Instruction) -> None:
        """Defer an operator: its operand is what the nested instructions leave (table 51)."""
        assert each.nested is not None
        op = _plain(each)
        there = self._is_there(each.span)
        left = self._result
        if there and left.where != "literal":
            self._to_stack(each.span)
            left = self._result
        right = self._nested(each, left if there else None)
        if right is None or not there:
            self._fail()
            return
        common = self._common(each, left.type, right)
        if common is None:
            self._fail()
            return
        second = second_type(op, common, right)
        self._expressions.convert(right, second, each.span)
        if left.where == "literal" or common != left.type:
            self._slip_under(left, common, second, each.span)
        self._apply(each, common, right)

    def _nested(self, each: s.Instruction, left: _Result | None) -> Type | None:
        """Push what the instructions between the parentheses leave, and return its type."""
        assert each.nested is not None
        wanted = find_wanted(each.nested, {}, True)
        self._depth += 1
        self._result = _Result()
        for n, inner in enumerate(each.nested):
            if inner.label:
                self._out.report.error("P0013", inner.span, "no label can stand in a parenthesis")
            if inner.op:
                self._instruction(inner, wanted[n + 1])
        right = self._to_stack(each.span, self._literal_target(left))
        self._depth -= 1
        return right

    def _literal_target(self, left: _Result | None) -> Type | None:
        """Return the type that a literal alone in a parenthesis takes from the left operand."""
        if left is None or self._result.type.kind != "literal" or left.type.kind == "time":
            return None
        if left.literal is not None and left.type.kind == "literal":
            return default_type(left.literal, left.type)
        return left.type

    def _slip_under(self, left: _Result, common: Type, second: Type,
                    span: Span) -> None:
        """Bring the left operand, as the common type, under the right one on the stack."""
        kept = self._out.new_local(second.machine)
        self._out.emit("set", kept, span)
        if left.where == "literal":
            assert left.literal is not None
            self._expressions.emit(left.literal, common)
        else:
            self._expressions.convert(left.type, common, span)
        self._out.emit("get", kept, span)


def _plain(each: s.Instruction) -> str:
    return "AND" if each.op == "&" else each.op
