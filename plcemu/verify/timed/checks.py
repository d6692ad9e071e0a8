"""Which checks suit a closed loop in time."""

from __future__ import annotations

from plcemu.monitor.formula import Formula
from plcemu.verify.check import Check, Invariant, NoCheck, NoDeadlock, Reachable
from plcemu.verify.predicates import Predicates
from plcemu.verify.timed.clocks import clock_names
from plcemu.verify.timed.loop import TimedLoop
from plcemu.verify.timed.zones import ZoneTime

_CELL_BYTES = 16

REACHABILITY = (Invariant, Reachable, NoDeadlock)
"""The checks that zones serve: what can be reached, not what happens for ever."""


def reads_time(predicates: Predicates, formula: Formula) -> NoCheck | None:
    """Return why a formula that reads an elapsed time is not judged, if it does."""
    program = predicates.program
    if predicates.check(formula):
        return None
    looked_at, names = predicates.bytes_of([formula]), clock_names(program)
    for clock in program.layout.clocks:
        cell = set(range(clock.offset, clock.offset + _CELL_BYTES))
        if clock.expiry is not None:
            cell |= set(range(clock.expiry.copy, clock.expiry.copy + _CELL_BYTES // 2))
        if looked_at & cell:
            return _refusal(names[clock.offset])
    return None


def _refusal(name: str) -> NoCheck:
    return NoCheck(f"it reads the elapsed time {name}, of which merge: timed only keeps what the "
                   "program compares it with: ask for the step or the timer's Q instead")


def suited(loop: TimedLoop, predicates: Predicates, check: Check) -> Check:
    """Return a check if it suits, or in its place one that says why not."""
    if isinstance(check, NoCheck):
        return check
    if isinstance(loop, ZoneTime) and not isinstance(check, REACHABILITY):
        return NoCheck("with zones only what can be reached is proved (G p, EF p, deadlocks): "
                       "verify with verify.time: integer", check.watched, check.tested)
    looked_at = predicates.bytes_of([*check.watched, *check.tested])
    if looked_at & loop.seen.copies:
        copy = next(s.tag.name for s in predicates.slots if s.offset in looked_at &
                    loop.seen.copies)
        return NoCheck(_refusal(copy).reason, check.watched, check.tested)
    return check
