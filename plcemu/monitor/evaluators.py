"""The two ways to judge a formula while it happens.

`Response` is the common case, G (p -> F[0,b] q) over state formulas, with G p, G (p -> q),
G F[0,b] q and G F q as its special cases. Of all open triggers only the oldest matters, because
one q answers them all: the cost of a change and the memory are constant. `General` takes every
linear formula, by a network of signals.

Both are told values at the instants of change, and name the instant at which time alone will
decide. Verdicts are True, False or None (open).
"""

from __future__ import annotations

from typing import Protocol

from plcemu.monitor.bind import Binder, State, Values
from plcemu.monitor.formula import TRUE, Binary, Formula, Interval, Literal, Unary, is_state
from plcemu.monitor.network import Builder, Node, total_reach_ns
from plcemu.monitor.signals import NO, OPEN, YES, value_at


class Evaluator(Protocol):
    """What judges one formula.

    Attributes:
        triggers: how often the formula was put to the test.
        trigger_ns: after a violation, the instant whose demand was not met; None if there is none.
        deadline_ns: the first instant at which the verdict falls if nothing changes; None if
            time alone decides nothing.
    """

    triggers: int
    trigger_ns: int | None
    deadline_ns: int | None

    def step(self, t_ns: int, now: Values, before: Values) -> bool | None:
        """Take the values from an instant on; before it lie the values `before`."""

    def expire(self) -> bool:
        """Return the verdict at the deadline, which has passed."""

    def presume(self, t_ns: int) -> bool:
        """Tell whether the formula holds if the run ends with the instant `t_ns`."""


class Response:
    """G (p -> F[0,b] q); `premise` None stands for TRUE, `bound_ns` None for no bound."""

    def __init__(self, premise: State | None, goal: State, bound_ns: int | None) -> None:
        self.premise, self.goal, self.bound_ns = premise, goal, bound_ns
        self.pulsed = goal.pulsed or (premise is not None and premise.pulsed)
        self.triggers = 0
        self.trigger_ns: int | None = None
        self.deadline_ns: int | None = None
        self._open_ns: int | None = None
        self._was = False
        self._after_ns = -1
        self._at: tuple[int, int | None, bool] = (0, None, False)

    def step(self, t_ns: int, now: Values, before: Values) -> bool | None:
        if t_ns == self._after_ns:
            # What was foreseen for this instant is overtaken by what did happen.
            self.triggers, self._open_ns, self._was = self._at
        self._apply(t_ns, now, before)
        if self.deadline_ns is not None and self.deadline_ns <= t_ns:
            self.trigger_ns = self._open_ns
            return False
        if self.pulsed:
            self._after_ns = t_ns + 1
            self._at = (self.triggers, self._open_ns, self._was)
            tests = self.triggers
            self._apply(t_ns + 1, now, now)
            if self.premise is None and self.bound_ns == 0:
                self.triggers = tests
        return None

    def _apply(self, t_ns: int, now: Values, before: Values) -> None:
        due = self.premise is None or self.premise.holds(now, before)
        done = self.goal.holds(now, before)
        if self.premise is not None:
            self._count(bool(due))
        elif self.bound_ns == 0:
            self.triggers += 1
        else:
            self._count(bool(done))
        if done:
            self._open_ns = None
        elif due and self._open_ns is None:
            self._open_ns = t_ns
        self.deadline_ns = None
        if self._open_ns is not None and self.bound_ns is not None:
            self.deadline_ns = self._open_ns + self.bound_ns

    def _count(self, holds: bool) -> None:
        if holds and not self._was:
            self.triggers += 1
        self._was = holds

    def expire(self) -> bool:
        self.trigger_ns = self._open_ns
        return False

    def presume(self, t_ns: int) -> bool:
        return (self._at[1] if t_ns < self._after_ns else self._open_ns) is None


class General:
    """Any linear formula; times are counted from the first frame."""

    def __init__(self, formula: Formula, binder: Binder) -> None:
        builder = Builder(binder.compile)
        self.root = builder.build(formula)
        self.atoms = builder.atoms
        self.reach_ns = total_reach_ns(self.root)
        self.triggers = 0
        self.trigger_ns: int | None = None
        self.deadline_ns: int | None = None
        self._start_ns: int | None = None
        shape = _Shape(formula)
        self._repeated, self._first_ns = shape.repeated, shape.first_ns
        self._body = builder.nodes[id(shape.body)]
        self._counted: Node | None = builder.nodes.get(id(shape.counted))
        self._last_counted = -1

    def step(self, t_ns: int, now: Values, before: Values) -> bool | None:
        if self._start_ns is None:
            self._start_ns = t_ns
        t = t_ns - self._start_ns
        self.triggers += self._counted is None
        for atom in self.atoms:
            holds = atom.state.holds
            at = bool(holds(now, before))
            atom.step(t, at, bool(holds(now, now)) if atom.state.pulsed else at)
        verdict = self._commit(t)
        if verdict is None:
            self.deadline_ns = self._foresee(t)
        return verdict

    def _commit(self, t: int) -> bool | None:
        """Settle everything up to and with an instant."""
        self.root.commit(t)
        self._count()
        verdict = value_at(self.root.out, 0)
        if verdict == OPEN:
            self.root.forget(0)
            return None
        if verdict == NO:
            self.trigger_ns = self._first_broken()
        return verdict == YES

    def _foresee(self, t: int) -> int | None:
        """Return when the verdict falls if nothing changes after the instant `t`.

        What is known never grows less as time passes, so the first instant is found by bisection.
        """
        early, late = t, t + 2 * self.reach_ns + 2
        if self.reach_ns == 0 or self._open_at(late):
            return None
        assert self._start_ns is not None
        if self.deadline_ns is not None:
            # Mostly the oldest obligation stays the one that decides: look there first.
            last = self.deadline_ns - self._start_ns
            if self._open_at(last):
                early = last
            elif self._open_at(last - 1):
                return self.deadline_ns
            else:
                late = last
        while late - early > 1:
            middle = (early + late) // 2
            early, late = (middle, late) if self._open_at(middle) else (early, middle)
        return self._start_ns + late

    def _open_at(self, t: int) -> bool:
        """Tell whether the verdict would still be open at an instant if nothing changed."""
        return value_at(self.root.known(t), 0) == OPEN

    def _count(self) -> None:
        if self._counted is None:
            return
        for start, value in self._counted.out:
            fresh = self._last_counted < start < self._counted.settled
            if fresh and value == YES and (self._repeated or start == 0):
                self.triggers += 1
                self._last_counted = start

    def _first_broken(self) -> int | None:
        assert self._start_ns is not None
        if not self._repeated:
            return self._start_ns
        broken = [s for s, value in self._body.out if value == NO and s >= self._first_ns]
        return self._start_ns + broken[0] if broken else None

    def expire(self) -> bool:
        assert self.deadline_ns is not None and self._start_ns is not None
        return bool(self._commit(self.deadline_ns - self._start_ns))

    def presume(self, t_ns: int) -> bool:
        assert self._start_ns is not None
        t = t_ns - self._start_ns
        self.root.commit(t)
        return value_at(self.root.finite(t), 0) == YES


class _Shape:
    """What a formula demands again and again, and what puts it to the test.

    Attributes:
        repeated: whether the formula is G body.
        first_ns: the first instant that G looks at.
        body: what is demanded.
        premise: p, if the body is p -> q.
        counted: whose becoming true counts as a test; None counts changes instead.
    """

    def __init__(self, formula: Formula) -> None:
        self.repeated = isinstance(formula, Unary) and formula.op == "G"
        self.first_ns, self.body = 0, formula
        if isinstance(formula, Unary) and self.repeated:
            self.body = formula.arg
            self.first_ns = (formula.interval or Interval()).first_ns
        body = self.body
        conditional = isinstance(body, Binary) and body.op == "->"
        self.premise = body.left if isinstance(body, Binary) and conditional else None
        again = self.repeated and isinstance(body, Unary) and body.op == "F"
        self.counted = body.arg if isinstance(body, Unary) and again else self.premise


def premise_of(formula: Formula) -> Formula | None:
    """Return p of a formula of the shape p -> q or G (p -> q), else None."""
    return _Shape(formula).premise


def body_of(formula: Formula) -> Formula:
    """Return what a formula demands at each instant: the body of G, or the formula itself."""
    return _Shape(formula).body


def make_evaluator(formula: Formula, binder: Binder) -> Evaluator:
    """Return the cheapest evaluator that can judge a checked linear formula."""
    shape = _Shape(formula)
    whole = isinstance(formula, Unary) and formula.op == "G" and formula.interval is None
    premise, goal = shape.premise or TRUE, shape.body
    if isinstance(shape.body, Binary) and shape.premise is not None:
        goal = shape.body.right
    bound: int | None = 0
    if isinstance(goal, Unary) and goal.op == "F":
        interval = goal.interval or Interval()
        whole = whole and interval.first_ns == 0
        bound, goal = interval.last_ns, goal.arg
    constant = isinstance(goal, Literal) or (isinstance(premise, Literal) and premise != TRUE)
    if constant or not (whole and is_state(premise) and is_state(goal)):
        return General(formula, binder)
    return Response(None if premise == TRUE else binder.compile(premise),
                    binder.compile(goal), bound)


__all__ = ["Evaluator", "General", "Response", "body_of", "make_evaluator", "premise_of"]
