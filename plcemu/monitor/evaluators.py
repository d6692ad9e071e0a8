"""The ways to judge a formula while it happens, and which serves for which.

All are told values at the instants of change, and name the instant at which time alone will
decide. Verdicts are NO, UNSURE, YES (`plcemu.monitor.signals`), or None while open.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from plcemu.base.trace import Frame
from plcemu.monitor.bind import Binder, State, Values
from plcemu.monitor.formula import (
    TRUE,
    Binary,
    Formula,
    Interval,
    Literal,
    Unary,
    is_state,
)
from plcemu.monitor.general import General, Shape
from plcemu.monitor.precedence import Precedence
from plcemu.monitor.response import Response
from plcemu.monitor.signals import NO, UNSURE, YES
from plcemu.monitor.verdict import Obligation


class Evaluator(Protocol):
    """What judges one formula.

    Attributes:
        triggers: how often the formula was put to the test.
        trigger_ns: after a violation, the instant whose demand was not met; None if there is none.
        deadline_ns: an instant before which time alone decides nothing; None if it never does.
        restless: whether `presume` may change while nothing is told.
    """

    triggers: int
    trigger_ns: int | None
    deadline_ns: int | None
    restless: bool

    def step(self, frame: Frame, now: Values, before: Values, sure: bool) -> int | None:
        """Take the values from an instant on; `sure` says that all of them are known."""

    def lapse(self, t_ns: int) -> tuple[int, int] | None:
        """Take it that nothing changed up to an instant not before the deadline.

        Returns the verdict and its instant, if one fell.
        """

    def exact_deadline_ns(self) -> int | None:
        """Return the first instant at which the verdict falls if nothing changes."""

    def presume(self, t_ns: int) -> int:
        """Return the verdict if the run ended with an instant."""

    def obligations(self, t_ns: int) -> Sequence[Obligation]:
        """Return what is still owed."""


class Invariant:
    """G p for a p that never looks back."""

    restless = False

    def __init__(self, demand: State) -> None:
        self.demand = demand
        self.triggers = 0
        self.trigger_ns: int | None = None
        self.deadline_ns: int | None = None
        self._holds = demand.holds
        self._unsure = False

    def step(self, frame: Frame, now: Values, before: Values, sure: bool) -> int | None:
        """Take the values from an instant on."""
        self.triggers += 1
        held = self._holds(now, before) if sure else self.demand.kleene(now, before)
        if held:
            return None
        if held is None:
            self._unsure = True
            return None
        self.trigger_ns = frame.t_ns
        return NO

    def lapse(self, t_ns: int) -> tuple[int, int] | None:
        """Time alone decides nothing."""

    def exact_deadline_ns(self) -> int | None:
        """Time alone decides nothing."""

    def presume(self, t_ns: int) -> int:
        """Return the verdict if the run ended here."""
        return UNSURE if self._unsure else YES

    def obligations(self, t_ns: int) -> Sequence[Obligation]:
        """Nothing is ever owed."""
        return ()


def make_evaluator(formula: Formula, binder: Binder) -> Evaluator:
    """Return the cheapest evaluator that can judge a checked linear formula."""
    shape = Shape(formula)
    whole = isinstance(formula, Unary) and formula.op == "G" and formula.interval is None
    premise, goal = shape.premise or TRUE, shape.body
    if isinstance(shape.body, Binary) and shape.premise is not None:
        goal = shape.body.right
    past = isinstance(goal, Unary) and goal.op == "O"
    bound: int | None = 0
    if isinstance(goal, Unary) and goal.op in ("F", "O"):
        interval = goal.interval or Interval()
        whole = whole and interval.first_ns == 0
        bound, goal = interval.last_ns, goal.arg
    constant = isinstance(goal, Literal) or (isinstance(premise, Literal) and premise != TRUE)
    if constant or not (whole and is_state(premise) and is_state(goal)) or (past and bound is None):
        return General(formula, binder)
    demand = binder.compile(goal)
    given = None if premise == TRUE else binder.compile(premise)
    if past and bound is not None:
        return Precedence(given, demand, bound)
    if given is None and bound == 0 and not demand.pulsed:
        return Invariant(demand)
    return Response(given, demand, bound)


def premise_of(formula: Formula) -> Formula | None:
    """Return p of a formula of the shape p -> q or G (p -> q), else None."""
    return Shape(formula).premise


def body_of(formula: Formula) -> Formula:
    """Return what a formula demands at each instant: the body of G, or the formula itself."""
    return Shape(formula).body


__all__ = ["Evaluator", "General", "Invariant", "Precedence", "Response", "body_of",
           "make_evaluator", "premise_of"]
