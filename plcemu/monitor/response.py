"""The common case, G (p -> F[0,b] q) over state formulas, at constant cost and memory.

G p, G (p -> q), G F[0,b] q and G F q are its special cases. Of all open triggers only the oldest
decides, because one q answers them all. Where p or q hinges on a value that is not known, a
trigger is in doubt: it can no longer violate the formula, and if no q comes in time, the formula
can no longer be told to hold either.
"""

from __future__ import annotations

from collections.abc import Sequence

from plcemu.base.trace import Frame
from plcemu.monitor.bind import State, Values
from plcemu.monitor.signals import NO, UNSURE, YES
from plcemu.monitor.verdict import Obligation

SHOWN = 16
"""The largest number of open triggers that are kept to be shown."""


class Response:
    """Judges G (p -> F[0,b] q).

    Attributes:
        triggers: how often p became true (without p: how often q did, or changes for G q).
        trigger_ns: after a violation, the instant whose demand was not met.
        deadline_ns: the first instant at which the verdict falls if nothing changes; None if time
            alone decides nothing.

    Args:
        premise: p; None stands for TRUE.
        goal: q.
        bound_ns: b; None for no bound.
    """

    def __init__(self, premise: State | None, goal: State, bound_ns: int | None) -> None:
        self.premise, self.goal, self.bound_ns = premise, goal, bound_ns
        self.pulsed = goal.pulsed or (premise is not None and premise.pulsed)
        self.triggers = 0
        self.trigger_ns: int | None = None
        self.deadline_ns: int | None = None
        # A pulse is over in the next ns.
        self.restless = self.pulsed
        self._due = premise.holds if premise is not None and not self.pulsed else None
        self._done = goal.holds
        self._open_ns: int | None = None
        self._doubt_ns: int | None = None
        self._unsure = False
        self._was = False
        self._pending: tuple[int, ...] = ()
        self._after_ns = -1
        self._at: tuple[int, int | None, int | None, bool, bool, tuple[int, ...]] | None = None

    def step(self, frame: Frame, now: Values, before: Values, sure: bool) -> int | None:
        """Take the values from an instant on; before it lie the values `before`."""
        t_ns = frame.t_ns
        if sure and self._due is not None and self._doubt_ns is None:
            return self._quick(t_ns, self._due(now, before), self._done(now, before))
        if self.pulsed and t_ns == self._after_ns:
            # What was foreseen for this instant is overtaken by what did happen.
            self._restore()
        self._apply(t_ns, now, before, sure)
        if self.deadline_ns is not None and self.deadline_ns <= t_ns:
            self.trigger_ns = self._open_ns
            return NO
        if self.pulsed:
            self._after_ns = t_ns + 1
            self._at = (self.triggers, self._open_ns, self._doubt_ns, self._unsure, self._was,
                        self._pending)
            tests = self.triggers
            self._apply(t_ns + 1, now, now, sure)
            if self.premise is None and self.bound_ns == 0:
                self.triggers = tests
        return None

    def _quick(self, t_ns: int, due: bool | None, done: bool | None) -> int | None:
        """Take p and q where both are known, there is a p, and neither looks back."""
        if not due:
            self._was = False
        elif not self._was:
            self._count(t_ns, due, done)
        if done:
            if self._open_ns is not None:
                self._open_ns = self.deadline_ns = None
            if self._pending:
                self._pending = ()
        elif due and self._open_ns is None:
            self._open_ns = t_ns
            if self.bound_ns is not None:
                self.deadline_ns = t_ns + self.bound_ns
                if self.bound_ns == 0:
                    self.trigger_ns = t_ns
                    return NO
        return None

    def _restore(self) -> None:
        assert self._at is not None
        (self.triggers, self._open_ns, self._doubt_ns, self._unsure, self._was,
         self._pending) = self._at

    def _apply(self, t_ns: int, now: Values, before: Values, sure: bool) -> None:
        premise, goal = self.premise, self.goal
        due: bool | None
        if sure:
            due = premise is None or premise.holds(now, before)
            done = goal.holds(now, before)
        else:
            due = True if premise is None else premise.kleene(now, before)
            done = goal.kleene(now, before)
        if self._doubt_ns is not None:
            self._resolve_doubt(t_ns)
        self._count(t_ns, due, done)
        if done:
            self._open_ns = self._doubt_ns = self.deadline_ns = None
            self._pending = ()
            return
        if done is None or due is None:
            self._in_doubt(t_ns, due, done)
        elif due and self._open_ns is None:
            self._open_ns = t_ns
        if self._open_ns is not None and self.bound_ns is not None:
            self.deadline_ns = self._open_ns + self.bound_ns
        else:
            self.deadline_ns = None

    def _in_doubt(self, t_ns: int, due: bool | None, done: bool | None) -> None:
        """Take it that a trigger or an answer is not known for certain."""
        if done is None and self._open_ns is not None:
            if self._doubt_ns is None:
                self._doubt_ns = self._open_ns
            self._open_ns = None
        if (due is None or due) and self._doubt_ns is None:
            self._doubt_ns = t_ns
        self._resolve_doubt(t_ns)

    def _resolve_doubt(self, t_ns: int) -> None:
        """Give up a trigger in doubt whose time is over."""
        if self._doubt_ns is not None and self.bound_ns is not None \
                and self._doubt_ns + self.bound_ns <= t_ns:
            self._unsure, self._doubt_ns = True, None

    def _count(self, t_ns: int, due: bool | None, done: bool | None) -> None:
        if self.premise is None and self.bound_ns == 0:
            self.triggers += 1
            return
        holds = bool(due if self.premise is not None else done)
        if holds and not self._was:
            self.triggers += 1
            if self.premise is not None and len(self._pending) < SHOWN:
                self._pending = (*self._pending, t_ns)
        self._was = holds

    def lapse(self, t_ns: int) -> tuple[int, int] | None:
        """Take it that nothing changed up to an instant that is not before the deadline."""
        assert self.deadline_ns is not None
        self.trigger_ns = self._open_ns
        return NO, self.deadline_ns

    def exact_deadline_ns(self) -> int | None:
        """Return the first instant at which the verdict falls if nothing changes."""
        return self.deadline_ns

    def presume(self, t_ns: int) -> int:
        """Return the verdict if the run ended with an instant."""
        early = self._at if self._at is not None and t_ns < self._after_ns else None
        open_ns, doubt_ns, unsure = early[1:4] if early else (
            self._open_ns, self._doubt_ns, self._unsure)
        if open_ns is not None:
            return NO
        return UNSURE if unsure or doubt_ns is not None else YES

    def obligations(self, t_ns: int) -> Sequence[Obligation]:
        """Return the triggers that still wait for an answer, oldest first."""
        if self._open_ns is None:
            return []
        since = [self._open_ns, *(t for t in self._pending if t > self._open_ns)]
        return [Obligation(t, None if self.bound_ns is None else t + self.bound_ns)
                for t in since if t <= t_ns]
