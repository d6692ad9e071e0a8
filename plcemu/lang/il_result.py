"""The current result of Instruction List while its code is written.

It is kept where it costs least: as a literal not yet emitted, on the stack, or in a local variable.
It moves to a local only when more than one instruction takes it, or when it is wanted behind a
label, where the IR's stack is empty.
"""

from __future__ import annotations

from dataclasses import dataclass

from plcemu.base.spans import Span
from plcemu.lang import syntax as s
from plcemu.lang.emitter import Emitter
from plcemu.lang.expressions import Expressions, default_type
from plcemu.lang.types import BOOL, Type


@dataclass(slots=True)
class Result:
    """A current result.

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


class CurrentResult:
    """Holds the current result of one function and moves it where it is needed.

    Attributes:
        result: what it is now.
        depth: how many parentheses are open; each level has locals of its own.
    """

    def __init__(self, emitter: Emitter, expressions: Expressions) -> None:
        self._out = emitter
        self._expressions = expressions
        self._spills: dict[tuple[int, str], int] = {}
        self.result = Result()
        self.depth = 0

    def forget(self, span: Span) -> None:
        """Drop the current result."""
        if self.result.where == "stack":
            self._out.emit("drop", None, span)
        self.result = Result()

    def fail(self) -> None:
        """Go on without a current result after a reported mistake."""
        self.result = Result("unknown")

    def is_there(self, span: Span) -> bool:
        """Whether there is a current result; if there should be one, the report says so."""
        if self.result.where == "none":
            self._out.report.error("P0042", span, "there is no current result here; LD comes first")
            self.fail()
        return self.result.where != "unknown"

    def to_stack(self, span: Span, target: Type | None = None) -> Type | None:
        """Push the current result, perhaps widened; None after a reported mistake."""
        if not self.is_there(span):
            return None
        result, of = self.result, self.result.type
        if result.where == "literal":
            assert result.literal is not None
            of = target or default_type(result.literal, of)
            if not self._expressions.emit(result.literal, of):
                self.fail()
                return None
        elif result.where == "local":
            self._out.emit("get", result.local, span)
        if target is not None and of != target:
            self._expressions.convert(of, target, span)
            of = target
        self.result = Result("stack", of)
        return of

    def to_local(self, span: Span) -> Type | None:
        """Move the current result to a local, from where it can be taken more than once."""
        if self.result.where == "local":
            return self.result.type
        of = self.to_stack(span)
        if of is None:
            return None
        self.result = Result("local", of, None, self.spill(of))
        self._out.emit("set", self.result.local, span)
        return of

    def spill(self, of: Type) -> int:
        """Return the local in which the current result is kept at this depth of parentheses."""
        key = (self.depth, of.machine)
        if key not in self._spills:
            self._spills[key] = self._out.new_local(of.machine)
        return self._spills[key]

    def taken(self, wanted: bool, span: Span) -> Type | None:
        """Push the current result for one use, keeping it if it is wanted later."""
        kept = self.result
        if not wanted or kept.where in ("none", "unknown"):
            of = self.to_stack(span)
            if of is not None:
                self.result = Result()
            return of
        if kept.where == "literal":
            of = self.to_stack(span)
            if of is not None:
                self.result = kept
            return of
        of = self.to_local(span)
        if of is not None:
            self._out.emit("get", self.result.local, span)
        return of

    def is_bool(self, span: Span) -> bool:
        """Whether the current result is a BOOL; a mistake goes to the report."""
        if not self.is_there(span):
            return False
        if self.result.type.kind == "literal":
            self.result.type = BOOL
        if self.result.type == BOOL:
            return True
        self._out.report.error("P0023", span, f"a BOOL is needed here, the current result is "
                               f"{self.result.type.name}")
        self.fail()
        return False
