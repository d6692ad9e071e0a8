"""State formulas as fast functions of a memory block and a plant's facts.

The formulas are those of the monitors: the same parser, the same type checks, the same meaning.
Here they are compiled to read single bytes of memory, because a checker asks them in every scan.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from plcemu.base.errors import CompileError
from plcemu.base.spans import Diagnostic
from plcemu.base.tags import Tag, TagTable
from plcemu.base.types import Value, type_of
from plcemu.ir.program import Program
from plcemu.monitor.bind import STATE_SCOPE, Binder, Writer
from plcemu.monitor.formula import Element, Formula
from plcemu.monitor.names import Cells

PlantValues = Sequence[Value]
StateTest = Callable[[bytes, PlantValues], bool]
StateMask = Callable[[bytes, PlantValues], int]


class Predicates:
    """Compiles state formulas over the tags of a program and the facts of a plant.

    Args:
        program: whose memory is judged.
        facts: tags of the plant, `plant.overflow` and the like, in the order of their values.
    """

    def __init__(self, program: Program, facts: Sequence[Tag] = ()) -> None:
        self.program = program
        self.slots = program.layout.slots
        self.tags = TagTable([*(slot.tag for slot in self.slots), *facts])
        self._scope: dict[str, Any] = {"unpack": _unpack, **STATE_SCOPE}

    def check(self, formula: Formula) -> list[Diagnostic]:
        """Return what is wrong with a formula's names and types."""
        diagnostics: list[Diagnostic] = []
        Binder(self.tags, diagnostics).check(formula)
        return diagnostics

    def test(self, formula: Formula) -> StateTest:
        """Return a state formula as a function; raises `CompileError` if it is wrong."""
        function: StateTest = self._compiled(f"bool({self._expression(formula)})")
        return function

    def mask(self, formulas: Sequence[Formula]) -> StateMask:
        """Return several at once: bit n of the result is the truth of formula n."""
        bits = [f"({1 << n} if {self._expression(f)} else 0)" for n, f in enumerate(formulas)]
        function: StateMask = self._compiled(" | ".join(bits) or "0")
        return function

    def bytes_of(self, formulas: Sequence[Formula]) -> set[int]:
        """Return the bytes of memory that formulas look at."""
        found: set[int] = set()
        for formula in formulas:
            binder = Binder(self.tags, [])
            for index in binder.used(binder.check(formula)):
                if index < len(self.slots):
                    slot = self.slots[index]
                    found.update(range(slot.offset, slot.offset + type_of(slot.tag.type).size))
        return found

    def values(self, memory: bytes, plant: PlantValues) -> list[Value]:
        """Return the values of all tags, in their order."""
        return [*(type_of(s.tag.type).unpack(memory, s.offset) for s in self.slots), *plant]

    def _expression(self, formula: Formula) -> str:
        diagnostics: list[Diagnostic] = []
        binder = Binder(self.tags, diagnostics)
        known = binder.check(formula)
        if diagnostics:
            raise CompileError(diagnostics)
        writer = _Writer(binder, self.slots, self._scope)
        return writer.quick(known, "now")

    def _compiled(self, expression: str) -> Any:
        return eval(compile(f"lambda m, p: {expression}", "<states>", "eval"), self._scope)


def _unpack(memory: bytes, offset: int, type_name: str) -> Value:
    return type_of(type_name).unpack(memory, offset)


class _Writer(Writer):
    """Writes a formula as a Python expression over memory `m` and the plant's values `p`."""

    def __init__(self, binder: Binder, slots: Sequence[Any], scope: dict[str, Any]) -> None:
        super().__init__(binder)
        self.slots = slots
        self.scope = scope

    def value(self, index: int, state: str) -> str:
        if index >= len(self.slots):
            return f"p[{index - len(self.slots)}]"
        slot = self.slots[index]
        if slot.tag.type == "BOOL":
            return f"m[{slot.offset}]"
        return f"unpack(m, {slot.offset}, {slot.tag.type!r})"

    def element(self, formula: Element, cells: Cells, indices: Sequence[str], state: str) -> str:
        name = f"cells{len(self.scope)}"
        self.scope[name] = {
            where: eval(f"lambda m, p: {self.value(index, state)}", self.scope)
            for where, index in cells.at.items()}
        return f"{name}[{', '.join(indices)},](m, p)"


__all__ = ["PlantValues", "Predicates", "StateMask", "StateTest"]
