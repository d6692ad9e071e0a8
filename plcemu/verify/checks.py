"""The table of checks: which kinds of properties can be judged."""

from __future__ import annotations

from collections.abc import Callable

from plcemu.monitor.formula import Formula
from plcemu.verify.check import Check, Invariant, NoDeadlock, Reachable, Recurrence
from plcemu.verify.ctl import Branching
from plcemu.verify.ltl.check import Linear

CHECKS: list[Callable[[Formula], Check | None]] = [
    Invariant.of, Reachable.of, Recurrence.of, NoDeadlock.of, Branching.of, Linear.of]
"""Each takes a formula or returns None; the first that takes it judges it."""


def check_for(formula: Formula) -> Check:
    """Return the check of a formula."""
    return next(check for of in CHECKS if (check := of(formula)) is not None)
