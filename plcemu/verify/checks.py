"""The table of checks: which kinds of properties can be judged."""

from __future__ import annotations

from collections.abc import Callable

from plcemu.monitor.formula import Binary, Formula, Unary, walk
from plcemu.verify.check import Check, Invariant, NoCheck, NoDeadlock, Reachable, Recurrence
from plcemu.verify.ctl import Branching

CHECKS: list[Callable[[Formula], Check | None]] = [
    Invariant.of, Reachable.of, Recurrence.of, NoDeadlock.of, Branching.of]
"""Each takes a formula or returns None; the first that takes it judges it."""


def check_for(formula: Formula) -> Check:
    """Return the check of a formula."""
    for of in CHECKS:
        check = of(formula)
        if check is not None:
            return check
    timed = any(isinstance(p, (Unary, Binary)) and p.interval for p in walk(formula))
    return NoCheck("it speaks of durations, which are abstracted away here" if timed else
                   "no check for formulas of this form; there are G p, AG p, EF p, "
                   "G F p & G F q and formulas of CTL, with p, q of one instant")
