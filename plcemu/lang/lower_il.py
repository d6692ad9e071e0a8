"""Instruction List to IR, block by block, in the order in which the flow of control reaches them.

So what comes into a block is known when it is lowered, also if only a jump backwards leads there.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence

from plcemu.base.spans import Span
from plcemu.ir.program import Instr
from plcemu.lang import syntax as s
from plcemu.lang.emitter import Emitter
from plcemu.lang.expressions import Expressions, default_type, sized_literal
from plcemu.lang.il_calls import Calls
from plcemu.lang.il_flow import find_blocks, find_labels, find_wanted, is_jump
from plcemu.lang.il_result import CurrentResult, Result
from plcemu.lang.lower_st import Statements
from plcemu.lang.operators import apply_operator, operand_type, result_type, second_type
from plcemu.lang.types import BOOL, Place, Type, widens


class InstructionList:
    """Lowers one IL body into one function."""

    def __init__(self, emitter: Emitter) -> None:
        self._out = emitter
        self._statements = Statements(emitter)
        self._expressions: Expressions = self._statements.expressions
        self._current = CurrentResult(emitter, self._expressions)
        self._calls = Calls(emitter, self._statements, self._current, self._nested)
        self._labels: dict[str, int] = {}
        self._marks: dict[int, int] = {}
        self._wanted: list[bool] = []
        self._entries: dict[int, Result] = {}
        self._waiting: list[int] = []

    # ------------------------------------------------------------ blocks

    def lower(self, body: s.IlBody) -> None:
        """Append the code of a body, without the final return."""
        instructions = [self._calls.operator_of_input(each) for each in body.instructions]
        self._labels = find_labels(instructions)
        self._wanted = find_wanted(instructions, self._labels, bool(self._out.result))
        self._report_doubles(instructions)
        self._marks = {n: self._out.new_label() for n in sorted(self._labels.values())}
        blocks = dict(find_blocks(instructions))
        self._expect(0, Result())
        pieces: dict[int, list[Instr]] = {}
        while self._waiting:
            begin = heapq.heappop(self._waiting)
            pieces[begin] = self._block(instructions, begin, blocks[begin], body.span)
        for begin in sorted(blocks.keys() - pieces.keys()):
            # Nothing leads here: it is looked through for mistakes, but leaves no code.
            self._entries[begin] = Result("unknown")
            self._block(instructions, begin, blocks[begin], body.span)
        for begin in sorted(pieces):
            self._out.code.extend(pieces[begin])

    def _expect(self, begin: int, came: Result) -> Result:
        """Return the result that comes into a block: this one, unless one has come before."""
        if begin not in self._entries:
            self._entries[begin] = came
            heapq.heappush(self._waiting, begin)
        return self._entries[begin]

    def _report_doubles(self, instructions: Sequence[s.Instruction]) -> None:
        for n, each in enumerate(instructions):
            if each.label and self._labels[each.label.upper()] != n:
                self._out.report.error("P0041", each.span, f"label {each.label!r} stands twice")

    def _block(self, instructions: Sequence[s.Instruction], begin: int, end: int,
               span: Span) -> list[Instr]:
        """Return the code of a block; it tells the blocks that follow it what comes in."""
        before = len(self._out.code)
        self._current.result = self._entries[begin]
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
            self._current.forget(span)
        elif self._out.result:
            self._push_value(span)
        else:
            self._current.forget(span)

    def _enter_from(self, target: int, span: Span) -> None:
        """Tell the block that begins at `target` in which local the current result will come."""
        came = Result(self._current.result.where)
        if self._wanted[target] and came.where != "none":
            of = self._current.to_local(span)
            came = Result("unknown") if of is None else self._current.result
        known = self._expect(target, came if self._wanted[target] else Result())
        if known.where != "local":
            return
        if came.where == "none":
            self._out.report.error("P0042", span, "there is no current result here, but it is "
                                   "wanted behind the label")
        elif came.where == "local" and known.type != came.type:
            self._out.report.error("P0023", span, f"the current result is {came.type.name} here "
                                   f"and {known.type.name} on another way to the same label")

    # ------------------------------------------------------------ jumps and calls

    def _jump(self, each: s.Instruction, wanted: bool) -> None:
        assert isinstance(each.operand, s.Name)
        target = self._labels.get(each.operand.head.upper())
        if target is None:
            self._out.report.error("P0040", each.operand.span,
                                   f"there is no label {each.operand.head!r}")
        elif not each.conditional:
            self._enter_from(target, each.span)
            self._current.forget(each.span)
            self._out.emit("jump", self._marks[target], each.span)
        elif self._current.is_bool(each.span):
            self._enter_from(target, each.span)
            self._current.taken(wanted, each.span)
            op = "jumpifnot" if each.negated else "jumpif"
            self._out.emit(op, self._marks[target], each.span)
        else:
            self._expect(target, Result("unknown"))

    def _guarded(self, each: s.Instruction, wanted: bool) -> int:
        """Begin what a C or CN modifier guards; return the label behind it."""
        skip = self._out.new_label()
        if self._current.is_bool(each.span) and self._current.taken(wanted, each.span):
            self._out.emit("jumpif" if each.negated else "jumpifnot", skip, each.span)
        return skip

    def _call(self, each: s.Instruction, wanted: bool) -> None:
        assert isinstance(each.operand, s.Name)
        skip = self._guarded(each, wanted) if each.conditional else None
        if not wanted:
            self._current.forget(each.span)
        elif self._current.result.where == "stack":
            self._current.to_local(each.span)
        self._statements.invoke(s.Invoke(each.span, each.operand, self._calls.arguments(each)))
        if skip is not None:
            self._out.emit("label", skip, each.span)

    def _return(self, each: s.Instruction, wanted: bool) -> None:
        has_value = bool(self._out.result)
        skip = self._guarded(each, wanted or has_value) if each.conditional else None
        kept = self._current.result
        if has_value:
            self._push_value(each.span)
        elif skip is None:
            self._current.forget(each.span)
        self._out.emit("ret", None, each.span)
        self._current.result = Result()
        if skip is not None:
            self._out.emit("label", skip, each.span)
            self._current.result = kept

    def _push_value(self, span: Span) -> None:
        if self._current.is_bool(span):
            self._current.to_stack(span)

    # ------------------------------------------------------------ instructions

    def _instruction(self, each: s.Instruction, wanted: bool) -> None:
        if each.op == "LD":
            self._load(each)
        elif each.op in ("ST", "S", "R"):
            self._store(each, wanted)
        elif each.op in ("JMP", "CAL", "RET", "INPUT"):
            if self._current.depth:
                op = each.arguments[0].name if each.op == "INPUT" else each.op
                self._out.report.error("P0013", each.span, f"no {op} can stand in a parenthesis")
                self._current.fail()
                return
            {"JMP": self._jump, "CAL": self._call, "RET": self._return,
             "INPUT": self._calls.give_input}[each.op](each, wanted)
        elif each.op in ("FUNCTION", "FUNCTION("):
            self._calls.function(each)
        elif each.op == "NOT":
            self._not(each)
        elif each.nested is not None:
            self._parenthesis(each)
        else:
            self._operator(each)

    def _load(self, each: s.Instruction) -> None:
        assert each.operand is not None
        self._current.forget(each.span)
        of = self._expressions.infer(each.operand)
        if of is None:
            self._current.fail()
        elif isinstance(each.operand, s.Literal | s.Unary):
            self._current.result = Result("literal", of, each.operand)
        elif self._expressions.emit(each.operand, of):
            self._current.result = Result("stack", of)
        if each.negated:
            self._not(each)

    def _not(self, each: s.Instruction) -> None:
        if self._current.result.type.kind == "literal" and not self._current.is_bool(each.span):
            return
        is_bool = self._current.result.where == "literal" and self._current.result.type == BOOL
        of = self._current.to_stack(each.span, BOOL if is_bool else None)
        if of is None:
            return
        if of.kind in ("bool", "bits"):
            self._out.emit(f"not.{of.machine}", None, each.span)
        else:
            self._out.report.error("P0023", each.span, f"NOT does not fit {of.name}")
            self._current.fail()

    def _store(self, each: s.Instruction, wanted: bool) -> None:
        assert isinstance(each.operand, s.Name | s.Direct)
        found = self._statements.writable(each.operand)
        there = self._current.is_there(each.span)
        if found is None:
            return
        place, of = found
        if each.op != "ST" and of != BOOL:
            self._out.report.error("P0023", each.span, f"{each.op} sets a BOOL, not {of.name}")
        elif not there:
            return
        elif each.op == "ST":
            self._plain_store(each, place, of, wanted)
        elif self._current.is_bool(each.span) and self._current.taken(wanted, each.span):
            if each.op == "R":
                self._out.emit("not.bool", None, each.span)
            self._out.load(place, of, each.span)
            self._out.emit("or.bool" if each.op == "S" else "and.bool", None, each.span)
            self._out.store(place, of, each.span)

    def _plain_store(self, each: s.Instruction, place: Place, of: Type,
                     wanted: bool) -> None:
        if self._current.result.where == "literal":
            assert self._current.result.literal is not None
            if not self._expressions.emit(self._current.result.literal, of):
                return
        else:
            held = self._current.result.type
            if not widens(held, of):
                self._out.report.error("P0023", each.span, f"the current result is {held.name}, "
                                       f"{place.name} is {of.name}")
                return
            self._current.taken(wanted, each.span)
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
        if not self._current.is_there(each.span):
            return
        common = None if right is None else self._common(each, self._current.result.type, right)
        if right is None or common is None:
            self._current.fail()
        elif self._current.to_stack(each.span, common) is not None:
            if self._expressions.emit(each.operand, second_type(op, common, right)):
                self._apply(each, common, right)
            else:
                self._current.fail()

    def _common(self, each: s.Instruction, left: Type,
                right: Type) -> Type | None:
        """Return the type in which an operator works; None after a reported mistake."""
        if each.operand is not None:
            right = sized_literal(each.operand, right, left)
        common = operand_type(_plain(each), left, right)
        if common is None:
            self._out.report.error("P0023", each.span, f"{each.op} does not fit {left.name} and "
                                   f"{right.name}")
        elif common.kind == "literal":
            literals = [x for x in (self._current.result.literal, each.operand) if x is not None]
            return max((default_type(x, common) for x in literals), key=lambda of: of.size)
        return common

    def _apply(self, each: s.Instruction, common: Type, right: Type) -> None:
        op = _plain(each)
        if each.negated:
            self._out.emit(f"not.{common.machine}", None, each.span)
        apply_operator(self._out, op, common, right, each.span)
        self._current.result = Result("stack", result_type(op, common, right))

    def _parenthesis(self, each: s.Instruction) -> None:
        """Defer an operator: its operand is what the nested instructions leave (table 51)."""
        assert each.nested is not None
        op = _plain(each)
        there = self._current.is_there(each.span)
        left = self._current.result
        if there and left.where != "literal":
            self._current.to_stack(each.span)
            left = self._current.result
        right = self._nested(each, left if there else None)
        if right is None or not there:
            self._current.fail()
            return
        common = self._common(each, left.type, right)
        if common is None:
            self._current.fail()
            return
        second = second_type(op, common, right)
        self._expressions.convert(right, second, each.span)
        if left.where == "literal" or common != left.type:
            self._slip_under(left, common, second, each.span)
        self._apply(each, common, right)

    def _nested(self, each: s.Instruction, left: Result | None) -> Type | None:
        """Push what the instructions between the parentheses leave, and return its type."""
        assert each.nested is not None
        wanted = find_wanted(each.nested, {}, True)
        self._current.depth += 1
        self._current.result = Result()
        for n, inner in enumerate(each.nested):
            if inner.label:
                self._out.report.error("P0013", inner.span, "no label can stand in a parenthesis")
            if inner.op:
                self._instruction(inner, wanted[n + 1])
        right = self._current.to_stack(each.span, self._literal_target(left))
        self._current.depth -= 1
        return right

    def _literal_target(self, left: Result | None) -> Type | None:
        """Return the type that a literal alone in a parenthesis takes from the left operand."""
        if left is None or self._current.result.type.kind != "literal" or left.type.kind == "time":
            return None
        if left.literal is not None and left.type.kind == "literal":
            return default_type(left.literal, left.type)
        return left.type

    def _slip_under(self, left: Result, common: Type, second: Type,
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
