"""A compiled controller on the timed protocol: when each process starts, and its long-run period.

The controller decides, its scans take no time, and each process takes exactly its duration - the
same rules that a schedule is bound by, so the two can be compared to the unit of time.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from plcemu.base.errors import LimitError
from plcemu.verify.loop import ClosedLoop, State

EVENTS_LIMIT = 100_000
"""Ends of processes after which a run that has not come back to a state is given up."""


@dataclass(frozen=True, slots=True)
class Controlled:
    """A controller's run until it repeats itself or stands still.

    Attributes:
        starts: the starts as (units of time, process), in order.
        period: units of time per batch in the long run; None if it stands still or produces none.
    """

    starts: tuple[tuple[int, str], ...]
    period: Fraction | None


def run_controlled(loop: ClosedLoop, plant: Hashable, durations: Mapping[str, int],
                   counted: str) -> Controlled:
    """Run the closed loop from a plant's initial state until a state recurs.

    Args:
        loop: the program and the finite plant.
        plant: the initial state.
        durations: how long each process takes, in units of time.
        counted: the process whose start counts as a batch.

    Raises:
        LimitError: no state has recurred after `EVENTS_LIMIT` ends.
    """
    state = loop.settled_from(plant)
    left: dict[str, int] = {}
    starts: list[tuple[int, str]] = []
    seen: dict[Hashable, tuple[int, int]] = {}
    t = batches = 0
    for _ in range(EVENTS_LIMIT):
        for name in loop.pending(state):
            if name not in left:
                left[name] = durations[name]
                starts.append((t, name))
                batches += name == counted
        key = (state.memory, state.plant, tuple(sorted(left.items())))
        if key in seen or not left:
            since, made = seen.get(key, (t, batches))
            produced = batches - made
            return Controlled(tuple(starts), Fraction(t - since, produced) if produced else None)
        seen[key] = t, batches
        wait = min(left.values())
        t += wait
        ended = {name for name, units in left.items() if units == wait}
        left = {name: units - wait for name, units in left.items() if units > wait}
        state = loop.next(state, _action(loop, state, ended))
    raise LimitError(f"the controller's run has not repeated itself after {EVENTS_LIMIT:,} ends")


def _action(loop: ClosedLoop, state: State, ended: set[str]) -> Any:
    """Return the action that ends just these processes."""
    return next(a for a in loop.actions(state) if set(loop.done(a)) == ended)
