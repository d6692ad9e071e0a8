"""The common case of the past, G (p -> O[0,b] q) over state formulas, at constant cost and memory.

G O[0,b] q is its special case. Of all instants at which q held only the latest matters: p may hold
until b after it and no longer. Where q hinges on a value that is not known, two instants are kept:
the latest at which q certainly held, after whose time the formula is in doubt, and the latest at
which it may have held, after whose time it is violated.
"""

from __future__ import annotations

from collections.abc import Sequence

from plcemu.base.trace import Frame
from plcemu.monitor.bind import State, Values
from plcemu.monitor.signals import NO, UNSURE, YES
from plcemu.monitor.verdict import Obligation


class Precedence:
    """Judges G (p -> O[0,b] q).

    Attributes:
        triggers: how often p became true (without p: how often q did).
        trigger_ns: after a violation, the instant whose demand was not met.
        deadline_ns: the first instant at which, if nothing changes, the formula is violated or
            comes to be in doubt; None if time alone decides nothing.

    Args:
        premise: p; None stands for TRUE.
        goal: q.
        bound_ns: b. Without a bound one q would answer for ever: that is for `General`.
    """

    restless = False

    def __init__(self, premise: State | None, goal: State, bound_ns: int) -> None:
        self.premise, self.goal, self.bound_ns = premise, goal, bound_ns
        self.triggers = 0
        self.trigger_ns: int | None = None
        self.deadline_ns: int | None = None
        # Up to `_t_ns` everything is accounted for; after it p and q keep these values.
        self._t_ns: int | None = None
        self._q = NO
        self._p = NO if premise is not None else YES
        self._held_ns: int | None = None
        self._perhaps_ns: int | None = None
        self._unsure = self._was = False

    def step(self, frame: Frame, now: Values, before: Values, sure: bool) -> int | None:
        """Take the values from an instant on; before it lie the values `before`."""
        t_ns, premise, goal = frame.t_ns, self.premise, self.goal
        if sure and self._held_ns == self._perhaps_ns and UNSURE not in (self._p, self._q):
            return self._quick(t_ns, now, before)
        if self._t_ns is not None:
            self._pass(t_ns - 1)
        if premise is not None:
            self._p = _value(premise, now, before)
        self._q = _value(goal, now, before)
        self._pass(t_ns)
        if self._is_broken(t_ns):
            self.trigger_ns = t_ns
            return NO
        # A pulse is over in the next ns.
        if premise is not None and premise.pulsed:
            self._p = _value(premise, now, now)
        if goal.pulsed:
            self._q = _value(goal, now, now)
        self._foresee()
        return None

    def _quick(self, t_ns: int, now: Values, before: Values) -> int | None:
        """Take p and q where both are known and nothing has been in doubt since q held last."""
        premise, goal = self.premise, self.goal
        if self._t_ns is not None and self._t_ns < t_ns - 1:
            self._was = (self._q if premise is None else self._p) == YES
            if self._q == YES:
                self._held_ns = t_ns - 1
        p = premise is None or premise.holds(now, before)
        q = goal.holds(now, before)
        holds = bool(q if premise is None else p)
        self.triggers += holds and not self._was
        self._was, self._t_ns = holds, t_ns
        if q:
            self._held_ns = t_ns
        held_ns = self._perhaps_ns = self._held_ns
        if p and not self._covers(held_ns, t_ns):
            self.trigger_ns = t_ns
            return NO
        if premise is not None and premise.pulsed:
            p = premise.holds(now, now)
        if goal.pulsed:
            q = goal.holds(now, now)
        self._p, self._q = YES if p else NO, YES if q else NO
        self.deadline_ns = self._end_ns(t_ns, held_ns) if p and not q else None
        return None

    def _pass(self, t_ns: int) -> None:
        """Take it that p and q kept their values up to and with an instant."""
        if self._t_ns is not None and t_ns <= self._t_ns:
            return
        self._t_ns = t_ns
        if self._q == YES:
            self._held_ns = self._perhaps_ns = t_ns
        elif self._q == UNSURE:
            self._perhaps_ns = t_ns
        holds = (self._q if self.premise is None else self._p) == YES
        self.triggers += holds and not self._was
        self._was = holds
        if self._p != NO and self._q != YES and not self._covers(self._held_ns, t_ns):
            self._unsure = self._unsure or not self._is_broken(t_ns)

    def _covers(self, held_ns: int | None, t_ns: int) -> bool:
        """Whether q, which held last at an instant, lets p hold at another one."""
        return held_ns is not None and t_ns <= held_ns + self.bound_ns

    def _is_broken(self, t_ns: int) -> bool:
        return self._p == YES and not self._covers(self._perhaps_ns, t_ns)

    def _foresee(self) -> None:
        """Find the deadline."""
        assert self._t_ns is not None
        self.deadline_ns = None
        if self._p == YES and self._q == NO:
            self.deadline_ns = self._end_ns(self._t_ns, self._perhaps_ns)
        if self._p != NO and self._q != YES and not self._unsure:
            # What certainly held held perhaps, so this is not the later one.
            self.deadline_ns = self._end_ns(self._t_ns, self._held_ns)

    def _end_ns(self, t_ns: int, held_ns: int | None) -> int:
        """Return the first instant after one that q, which held last at another, does not cover."""
        return (t_ns if held_ns is None else max(t_ns, held_ns + self.bound_ns)) + 1

    def lapse(self, t_ns: int) -> tuple[int, int] | None:
        """Take it that nothing changed up to an instant that is not before the deadline."""
        assert self.deadline_ns is not None
        due_ns = self.deadline_ns
        self._pass(due_ns)
        if self._is_broken(due_ns):
            self.trigger_ns = due_ns
            return NO, due_ns
        self._foresee()
        return None

    def exact_deadline_ns(self) -> int | None:
        """Return the deadline, which is exact."""
        return self.deadline_ns

    def presume(self, t_ns: int) -> int:
        """Return the verdict if the run ended with an instant."""
        return UNSURE if self._unsure else YES

    def obligations(self, t_ns: int) -> Sequence[Obligation]:
        """Nothing is ever owed: all that counts is known at every instant."""
        return ()


def _value(state: State, now: Values, before: Values) -> int:
    found = state.kleene(now, before)
    return UNSURE if found is None else YES if found else NO
