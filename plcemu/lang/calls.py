"""Calls of functions in expressions: standard ones by their table, the user's by their frame.

A function's variables stand in a frame of its own, at a fixed place behind the state: functions
cannot contain themselves, so one frame is enough. Arguments are all evaluated before the first goes
into the frame, since evaluating one may call the same function.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from plcemu.base.errors import did_you_mean
from plcemu.base.types import ElementaryType
from plcemu.lang import functions
from plcemu.lang import syntax as s
from plcemu.lang.gates import split
from plcemu.lang.types import BlockType, Field, Place, Type, root

if TYPE_CHECKING:
    from plcemu.lang.expressions import Expressions


class Calls:
    """Infers and emits the calls of functions in one function's code."""

    def __init__(self, expressions: Expressions) -> None:
        self._ex = expressions
        self._rewritten: dict[s.Call, s.Expr] = {}
        self._ordered: dict[s.Call, list[s.Expr] | None] = {}

    # ------------------------------------------------------------ types

    def infer(self, call: s.Call) -> Type | None:
        """Return the type of a call's value, or None after a reported mistake."""
        block = self._ex.out.functions.block(call.name)
        gate, _ = split(call.arguments, block)
        if gate:
            self._ex.report.error("P0090", call.span, "EN and ENO inside of an expression are not "
                                  "supported yet", "assign the call's value to a variable first")
            return None
        if block is not None:
            self._match(call, block)
            result = block.fields.get(block.name.upper())
            return root(result.type) if result is not None else None
        row = functions.find(call.name)
        if row is None:
            self._unknown(call)
            return None
        arguments = self._standard_arguments(call, row)
        if arguments is None:
            return None
        if not functions.arguments_fit(self._ex, call, row, arguments):
            return None
        if row.rewrite is not None:
            self._rewritten[call] = row.rewrite(call, arguments)
            return self._ex.infer(self._rewritten[call])
        assert row.infer is not None
        return row.infer(self._ex, call, arguments)

    def _unknown(self, call: s.Call) -> None:
        known = [*functions.NAMES, *self._ex.out.functions.names,
                 *functions.near_conversions(call.name.upper())]
        self._ex.report.error("P0020", call.span, f"there is no function {call.name!r}",
                              did_you_mean(call.name, known).removeprefix("; "))

    # ------------------------------------------------------------ arguments

    def _standard_arguments(self, call: s.Call, row: functions.Standard) -> list[s.Expr] | None:
        """Return a standard function's inputs in order; None after a reported mistake."""
        if call not in self._ordered:
            self._ordered[call] = self._order(call, row)
        return self._ordered[call]

    def _order(self, call: s.Call, row: functions.Standard) -> list[s.Expr] | None:
        names, many = row.inputs, len(call.arguments)
        if any(a.is_output for a in call.arguments):
            self._ex.report.error("P0026", call.span, f"{row.name} has no outputs to take")
            return None
        if not (len(names) <= many <= (functions.MANY if row.extensible else len(names))):
            least = f"{len(names)} to {functions.MANY}" if row.extensible else f"{len(names)}"
            self._ex.report.error("P0026", call.span, f"{row.name} takes {least} arguments, "
                                  f"{many} are given")
            return None
        if not any(a.name for a in call.arguments):
            return [a.value for a in call.arguments]
        wanted = [*names, *(_next_name(names[-1], n) for n in range(1, many - len(names) + 1))]
        given = {a.name.upper(): a.value for a in call.arguments}
        if sorted(given) != sorted(wanted):
            self._ex.report.error("P0026", call.span, f"the inputs of {row.name} are "
                                  f"{', '.join(wanted)}; either all arguments have names or none")
            return None
        return [given[name] for name in wanted]

    def _match(self, call: s.Call, block: BlockType) -> list[tuple[Field, s.Argument]]:
        """Return which argument goes into which input; mistakes go to the report."""
        inputs = [f for f in block.fields.values() if f.section in ("VAR_INPUT", "VAR_IN_OUT")]
        given = [a for a in call.arguments if not a.is_output]
        named = [a for a in given if a.name]
        report = self._ex.report
        if named and len(named) != len(given):
            report.error("P0026", call.span, "either all arguments have names or none has")
            return []
        if not named and len(given) != len(inputs):
            report.error("P0026", call.span, f"{block.name} takes {len(inputs)} arguments, "
                         f"{len(given)} are given")
            return []
        if not named:
            return list(zip(inputs, given, strict=True))
        by_name = {f.name.upper(): f for f in inputs}
        matched = []
        for argument in given:
            field = by_name.pop(argument.name.upper(), None)
            if field is None:
                known = [f.name for f in inputs]
                report.error("P0026", argument.span, f"{block.name} has no such input left: "
                             f"{argument.name!r}", f"its inputs are {', '.join(known)}")
            else:
                matched.append((field, argument))
        return matched

    # ------------------------------------------------------------ code

    def emit(self, call: s.Call, of: Type) -> bool:
        """Push the value of a call whose type is inferred, in that type."""
        block = self._ex.out.functions.block(call.name)
        if block is not None:
            return self._emit_user(call, block)
        row = functions.find(call.name)
        assert row is not None
        if row.rewrite is not None:
            return self._ex.emit(self._rewritten[call], of)
        arguments = self._standard_arguments(call, row)
        assert arguments is not None
        assert row.emit is not None
        return row.emit(self._ex, call, arguments, of)

    def _emit_user(self, call: s.Call, block: BlockType) -> bool:
        out, frame = self._ex.out, self._ex.out.functions.frame(block.name)
        matched = self._match(call, block)
        pushed = [self._push(field, argument) for field, argument in matched]
        good = all(pushed)
        for field, argument in reversed(matched):
            out.store(Place("memory", frame + field.offset, field.type), field.type, argument.span)
        self._defaults(block, frame, {field.name for field, _ in matched}, call)
        out.emit("addr", ("memory", frame), call.span)
        out.emit("call", block.name.upper(), call.span)
        for argument in call.arguments:
            if argument.is_output:
                self._ex.take_output(argument, Place("memory", frame, block), block)
        self._push_result(block, frame, call)
        return good

    def _push(self, field: Field, argument: s.Argument) -> bool:
        """Push an argument's value, or the address of the variable for a VAR_IN_OUT."""
        if field.section == "VAR_IN_OUT":
            return self._ex.push_variable(argument, field)
        return self._ex.emit(argument.value, field.type)

    def _push_result(self, block: BlockType, frame: int, call: s.Call) -> None:
        """Push a function's value; a large one is kept apart, since the frame may be used again."""
        out, result = self._ex.out, block.fields[block.name.upper()]
        place = Place("memory", frame + result.offset, result.type)
        out.load(place, result.type, call.span)
        if not isinstance(result.type, ElementaryType):
            kept = Place("memory", out.functions.temporary(result.type.size), result.type)
            out.store(kept, result.type, call.span)
            out.load(kept, result.type, call.span)

    def _defaults(self, block: BlockType, frame: int, given: set[str], call: s.Call) -> None:
        """Give the inputs that the call leaves out their initial values."""
        for field in block.fields.values():
            if field.section == "VAR_INPUT" and field.name not in given:
                self._ex.out.initialise(Place("memory", frame + field.offset, field.type), field,
                                        call.span)


def _next_name(last: str, ahead: int) -> str:
    """Return the formal name of a further input: IN3 after IN2."""
    digits = last.lstrip("ABCDEFGHIJKLMNOPQRSTUVWXYZ")
    return last[:len(last) - len(digits)] + str(int(digits) + ahead)
