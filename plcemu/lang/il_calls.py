"""Calls in Instruction List: functions as operators and formally, and the operators of inputs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from plcemu.base.spans import Span
from plcemu.base.types import ElementaryType, StringType
from plcemu.lang import syntax as s
from plcemu.lang.emitter import Emitter
from plcemu.lang.expressions import default_type
from plcemu.lang.gates import Gate, gated
from plcemu.lang.il import input_operator
from plcemu.lang.il_result import CurrentResult, Result
from plcemu.lang.lower_st import Statements
from plcemu.lang.types import BOOL, BlockType, Type

Nested = Callable[[s.Instruction, Result | None], Type | None]
"""Pushes what the instructions between parentheses leave, and returns its type."""


class Calls:
    """Lowers the calls of one IL body.

    Args:
        emitter: of the function.
        statements: lowers the calls themselves.
        current: the current result.
        nested: lowers instructions between parentheses.
    """

    def __init__(self, emitter: Emitter, statements: Statements, current: CurrentResult,
                 nested: Nested) -> None:
        self._out = emitter
        self._statements = statements
        self._expressions = statements.expressions
        self._current = current
        self._nested = nested

    def operator_of_input(self, each: s.Instruction) -> s.Instruction:
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

    def give_input(self, each: s.Instruction, wanted: bool) -> None:
        """Give the current result to an input and call the function block (table 53, feature 3)."""
        assert isinstance(each.operand, s.Name)
        value = self._as_operand(each.span)
        if value is not None:
            name = each.arguments[0].name
            argument = s.Argument(each.span, name, value)
            self._statements.invoke(s.Invoke(each.span, each.operand, (argument,)))

    # ------------------------------------------------------------ functions

    def function(self, each: s.Instruction) -> None:
        """Call a function; its value is the new current result (table 53)."""
        assert isinstance(each.operand, s.Name)
        first: tuple[s.Argument, ...] = ()
        if each.op == "FUNCTION":
            value = self._as_operand(each.span)
            if value is None:
                return
            first = (s.Argument(value.span, "", value),)
        else:
            self._current.forget(each.span)
        call = s.Call(each.span, each.operand.head, first + self.arguments(each))
        gate, call = self._statements.ungated(call)
        if gate:
            self._gated(call, gate)
            return
        of = self._expressions.emit_natural(call)
        self._current.result = Result("unknown") if of is None else Result("stack", of)

    def _gated(self, call: s.Call, gate: Gate) -> None:
        """Call a function with EN and ENO; while EN is FALSE the current result is 0."""
        of = self._expressions.infer(call)
        if of is None or self._current.depth or not isinstance(of, ElementaryType):
            if of is not None:
                self._out.report.error("P0090", call.span, "EN and ENO are not supported here yet")
            self._current.fail()
            return
        of = default_type(call, of)
        local = self._current.spill(of)
        self._out.emit("const", (of.machine, 0), call.span)
        self._out.emit("set", local, call.span)
        with gated(self._statements, gate):
            if self._expressions.emit(call, of):
                self._out.emit("set", local, call.span)
        self._current.result = Result("local", of, None, local)

    def _as_operand(self, span: Span) -> s.Expr | None:
        """Return the current result as an operand of an expression; None after a mistake."""
        if not self._current.is_there(span):
            return None
        if self._current.result.where == "literal":
            return self._current.result.literal
        of = self._current.to_local(span)
        return None if of is None else self._named(self._current.result.local, of, span)

    def _named(self, local: int, of: Type, span: Span) -> s.Name:
        name = f"__RESULT {local}"
        self._out.name_local(name, local, of)
        return s.Name(span, (name,))

    def arguments(self, each: s.Instruction) -> tuple[s.Argument, ...]:
        """Return a call's arguments, those in the form of instructions put into locals first."""
        return tuple(replace(a, value=self._nested_argument(a.value))
                     if isinstance(a.value, s.Nested) else a for a in each.arguments)

    def _nested_argument(self, value: s.Nested) -> s.Expr:
        kept = self._current.result
        of = self._nested(s.Instruction(value.span, "", "", nested=value.instructions), None)
        self._current.result = kept
        local = self._out.new_local((of or BOOL).machine)
        if of is not None:
            self._out.emit("set", local, value.span)
        return self._named(local, of or BOOL, value.span)
