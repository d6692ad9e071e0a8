"""Statements of Structured Text to IR."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from plcemu.base.errors import did_you_mean
from plcemu.base.spans import Span
from plcemu.base.types import ElementaryType
from plcemu.lang import functions
from plcemu.lang import syntax as s
from plcemu.lang.constants import constant_value
from plcemu.lang.emitter import Emitter
from plcemu.lang.expressions import Expressions
from plcemu.lang.gates import Gate, gated, split
from plcemu.lang.splits import split_assignments
from plcemu.lang.types import BOOL, BlockType, Place, SubrangeType, Type, root


class Statements:
    """Lowers statements into one function.

    Args:
        emitter: of the function.
        of_chart: whether they are an SFC's own, which may set steps.
    """

    def __init__(self, emitter: Emitter, of_chart: bool = False) -> None:
        self.out = emitter
        self._of_chart = of_chart
        self.expressions = Expressions(emitter)
        self._exits: list[tuple[int, int]] = []

    def lower(self, statements: tuple[s.Statement, ...]) -> None:
        """Append the code of statements."""
        for statement in statements:
            _LOWER[type(statement)](self, statement)

    def assign(self, statement: s.Assign) -> None:
        """`target := value`; a call with EN assigns only while EN is TRUE."""
        if isinstance(statement.value, s.Call):
            gate, call = self.ungated(statement.value)
            if gate:
                with gated(self, gate):
                    self._assign(replace(statement, value=call))
                return
        self._assign(statement)

    def ungated(self, call: s.Call) -> tuple[Gate, s.Call]:
        """Return the EN and ENO of a function's call, and the call without them."""
        block = self.out.functions.block(call.name)
        gate, rest = split(call.arguments, block)
        again, rest = split(rest, block)
        for name, argument in again.items():
            self.out.report.error("P0026", argument.span, f"{name} is given twice")
        return gate, replace(call, arguments=rest) if gate else call

    def _assign(self, statement: s.Assign) -> None:
        target = self.writable(statement.target)
        if target is None:
            self.expressions.infer(statement.value)
            return
        narrow = target[0].type if isinstance(target[0].type, SubrangeType) else target[1]
        if self.expressions.emit(statement.value, narrow):
            self.out.store(target[0], target[1], statement.span)

    def writable(self, node: s.Name | s.Direct) -> tuple[Place, Type] | None:
        """Return the place of a variable that may be written; a mistake goes to the report."""
        return self.expressions.writable(node, self._of_chart)

    # ------------------------------------------------------------ calls

    def invoke(self, call: s.Invoke) -> None:
        """Call a function block instance: inputs in, body, outputs out (IEC 61131-3, 2.5.2)."""
        if self._is_function(call):
            return
        place = self.out.place(call.instance)
        self.out.scope.mark(call.instance.head, called=True)
        if place is None:
            return
        block = place.type
        if not isinstance(block, BlockType) or block.kind != "FUNCTION_BLOCK":
            self.out.report.error("P0026", call.instance.span,
                                  f"{call.instance} is not a function block instance")
            return
        gate, arguments = split(call.arguments, block)
        with gated(self, gate):
            self._invoke(replace(call, arguments=arguments), place, block)

    def _invoke(self, call: s.Invoke, place: Place, block: BlockType) -> None:
        call = replace(call, arguments=_with_outputs(call.arguments, block))
        self._inputs(call, place, block)
        self.out.push_address(place, call.span)
        self.out.emit("call", block.name.upper(), call.span)
        for argument in call.arguments:
            if argument.is_output:
                self.expressions.take_output(argument, place, block)

    def _is_function(self, call: s.Invoke) -> bool:
        """Call a function as a statement, whose value nobody takes, if the name is one's."""
        name = call.instance
        if len(name.parts) != 1 or self.out.scope.find(name.head.upper()) is not None \
                or (self.out.functions.block(name.head) is None
                    and functions.find(name.head) is None):
            return False
        gate, value = self.ungated(s.Call(call.span, name.head, call.arguments))
        parts = None if self.out.functions.block(name.head) is not None \
            else split_assignments(value, self.out.report)
        with gated(self, gate):
            if parts is not None:
                for part in parts:
                    self.assign(part)
            elif self.expressions.emit_natural(value) is not None:
                self.out.emit("drop", None, call.span)
        return True

    def _inputs(self, call: s.Invoke, place: Place, block: BlockType) -> None:
        inputs = [f for f in block.fields.values() if f.section in ("VAR_INPUT", "VAR_IN_OUT")]
        given = [a for a in call.arguments if not a.is_output]
        informal = [a for a in given if not a.name]
        if informal and len(informal) != len(given):
            self.out.report.error("P0026", call.span, "either all arguments have names or none has")
            return
        if len(informal) > len(inputs):
            self.out.report.error("P0026", informal[len(inputs)].span,
                                  f"{block.name} has {len(inputs)} inputs, "
                                  f"{len(informal)} are given")
            return
        seen: set[str] = set()
        for n, argument in enumerate(given):
            name = argument.name or inputs[n].name
            field = block.fields.get(name.upper())
            if field is None or field not in inputs:
                known = [f.name for f in inputs]
                hint = did_you_mean(name, known).removeprefix("; ")
                self.out.report.error("P0026", argument.span, f"{block.name} has no input {name!r}",
                                      hint or f"its inputs are {', '.join(known)}")
                continue
            if name.upper() in seen:
                self.out.report.error("P0026", argument.span, f"input {name!r} is given twice")
                continue
            seen.add(name.upper())
            target = replace(place, offset=place.offset + field.offset, type=field.type)
            good = self.expressions.push_variable(argument, field) \
                if field.section == "VAR_IN_OUT" \
                else self.expressions.emit(argument.value, field.type)
            if good:
                self.out.store(target, root(field.type), argument.span)

    def run_action(self, statement: s.RunAction) -> None:
        """Run an action's body on this instance."""
        self.out.emit("addr", ("this", 0), statement.span)
        self.out.emit("call", statement.function, statement.span)

    # ------------------------------------------------------------ control

    def condition(self, expr: s.Expr, false_label: int) -> None:
        """Jump to a label unless a BOOL expression is TRUE."""
        if self.expressions.emit(expr, BOOL):
            self.out.emit("jumpifnot", false_label, expr.span)

    def if_(self, statement: s.If) -> None:
        """IF, ELSIF, ELSE."""
        end = self.out.new_label()
        for condition, body in statement.branches:
            following = self.out.new_label()
            self.condition(condition, following)
            self.lower(body)
            self.out.emit("jump", end)
            self.out.emit("label", following)
        self.lower(statement.otherwise)
        self.out.emit("label", end)

    def case(self, statement: s.Case) -> None:
        """CASE: the first branch with a label that holds the selector's value."""
        of = self.expressions.emit_natural(statement.selector)
        if of is None:
            return
        if not isinstance(of, ElementaryType) or of.kind not in ("int", "uint", "bits", "enum"):
            self.out.report.error("P0023", statement.selector.span,
                                  f"CASE selects by an integer or an enumeration, not by {of.name}")
            return
        selector, end = Place("local", self.out.new_local(of.machine), of), self.out.new_label()
        self.out.store(selector, of, statement.selector.span)
        for ranges, body in statement.branches:
            hit, miss = self.out.new_label(), self.out.new_label()
            for low, high in ranges:
                self._in_range(selector, of, low, high, hit)
            self.out.emit("jump", miss)
            self.out.emit("label", hit)
            self.lower(body)
            self.out.emit("jump", end)
            self.out.emit("label", miss)
        self.lower(statement.otherwise)
        self.out.emit("label", end)

    def _in_range(self, selector: Place, of: ElementaryType, low: s.Expr, high: s.Expr,
                  hit: int) -> None:
        bounds = [(low, "eq")] if low is high else [(low, "ge"), (high, "le")]
        for expr, op in bounds:
            self.out.load(selector, of, expr.span)
            value = constant_value(expr, of, self.out.report, self.out.scope.lookup)
            self.out.emit("const", (of.machine, value), expr.span)
            self.out.emit(f"{op}.{of.machine}", None, expr.span)
        if low is not high:
            self.out.emit("and.bool", None, high.span)
        self.out.emit("jumpif", hit, low.span)

    def for_(self, statement: s.For) -> None:
        """FOR: the end and the step are evaluated once; the control variable ends past the end."""
        found = self.writable(statement.control)
        if found is None:
            return
        place, of = found
        if not isinstance(of, ElementaryType) or of.kind not in ("int", "uint"):
            self.out.report.error("P0023", statement.control.span,
                                  f"FOR counts an integer, not {of.name}")
            return
        last, step = self.out.new_local(of.machine), self.out.new_local(of.machine)
        start, leave = self.out.new_label(), self.out.new_label()
        by = statement.step or s.Literal(statement.span, "int", 1)
        for expr, number in ((statement.last, last), (by, step)):
            if self.expressions.emit(expr, of):
                self.out.emit("set", number, expr.span)
        self.assign(s.Assign(statement.span, statement.control, statement.first))
        self.out.emit("label", start)
        self._for_test(place, of, last, step, leave, statement.span)
        self._loop(statement.body, leave)
        self._for_step(place, of, step, leave, statement.span)
        self.out.emit("jump", start)
        self.out.emit("label", leave)

    def _for_test(self, place: Place, of: ElementaryType, last: int, step: int, leave: int,
                  span: Span) -> None:
        """Leave the loop when the control variable is past the end, in the step's direction."""
        down, body = self.out.new_label(), self.out.new_label()
        self._is_down(of, step, span)
        self.out.emit("jumpif", down, span)
        for op in ("le", "ge"):
            self.out.load(place, of, span)
            self.out.emit("get", last, span)
            self.out.emit(f"{op}.{of.machine}", None, span)
            self.out.emit("jumpifnot", leave, span)
            self.out.emit("jump", body, span)
            if op == "le":
                self.out.emit("label", down, span)
        self.out.emit("label", body, span)

    def _for_step(self, place: Place, of: ElementaryType, step: int, leave: int,
                  span: Span) -> None:
        """Add the step; leave if that wrapped around, or the loop would never end."""
        total = self.out.new_local(of.machine)
        self.out.load(place, of, span)
        self.out.emit("get", step, span)
        self.out.emit(f"add.{of.machine}", None, span)
        self.out.emit("set", total, span)
        self.out.emit("get", total, span)
        self.out.load(place, of, span)
        self.out.emit(f"lt.{of.machine}", None, span)
        self._is_down(of, step, span)
        self.out.emit("ne.bool", None, span)
        self.out.emit("jumpif", leave, span)
        self.out.emit("get", total, span)
        self.out.store(place, of, span)

    def _is_down(self, of: ElementaryType, step: int, span: Span) -> None:
        self.out.emit("get", step, span)
        self.out.emit("const", (of.machine, 0), span)
        self.out.emit(f"lt.{of.machine}", None, span)

    def while_(self, statement: s.While) -> None:
        """WHILE."""
        start, leave = self.out.new_label(), self.out.new_label()
        self.out.emit("label", start)
        self.condition(statement.condition, leave)
        self._loop(statement.body, leave)
        self.out.emit("jump", start)
        self.out.emit("label", leave)

    def repeat(self, statement: s.Repeat) -> None:
        """REPEAT."""
        start, leave = self.out.new_label(), self.out.new_label()
        self.out.emit("label", start)
        self._loop(statement.body, leave)
        self.condition(statement.condition, start)
        self.out.emit("label", leave)

    def _loop(self, body: tuple[s.Statement, ...], leave: int) -> None:
        following = self.out.new_label()
        self._exits.append((leave, following))
        self.lower(body)
        self._exits.pop()
        self.out.emit("label", following)

    def exit(self, statement: s.Exit) -> None:
        """EXIT and CONTINUE."""
        if not self._exits:
            name = "CONTINUE" if statement.goes_on else "EXIT"
            self.out.report.error("P0010", statement.span, f"{name} stands outside of any loop")
            return
        self._leave("jump", self._exits[-1][statement.goes_on], statement.span)

    def return_(self, statement: s.Return) -> None:
        """RETURN."""
        self._leave("ret", None, statement.span)

    def _leave(self, op: str, arg: object, span: Span) -> None:
        self.out.emit(op, arg, span)
        self.out.emit("label", self.out.new_label())


def _with_outputs(arguments: tuple[s.Argument, ...],
                  block: BlockType) -> tuple[s.Argument, ...]:
    """Give the outputs in an informal list, which stand behind the inputs, names (table 53)."""
    fields = [f for f in block.fields.values()
              if f.section in ("VAR_INPUT", "VAR_OUTPUT", "VAR_IN_OUT")]
    inputs = sum(f.section != "VAR_OUTPUT" for f in fields)
    if not inputs < len(arguments) <= len(fields) or any(a.name for a in arguments) \
            or not all(isinstance(a.value, s.Name | s.Direct)
                       for f, a in zip(fields, arguments, strict=False)
                       if f.section == "VAR_OUTPUT"):
        return arguments
    return tuple(replace(a, name=f.name, is_output=f.section == "VAR_OUTPUT")
                 for f, a in zip(fields, arguments, strict=False))


_LOWER: dict[type, Callable[[Statements, Any], None]] = {
    s.Assign: Statements.assign, s.Invoke: Statements.invoke, s.RunAction: Statements.run_action,
    s.If: Statements.if_, s.Case: Statements.case, s.For: Statements.for_,
    s.While: Statements.while_, s.Repeat: Statements.repeat, s.Exit: Statements.exit,
    s.Return: Statements.return_,
}
