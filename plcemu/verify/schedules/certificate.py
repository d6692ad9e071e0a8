"""Checks a proof of a least period against the timed system itself, in a few lines.

Nothing of the search is used here: every state that can be reached is visited anew, every move is
asked for its inequality, and the cycle is walked along.
"""

from __future__ import annotations

from collections.abc import Hashable
from typing import TypeVar

from plcemu.verify.schedules.schedule import Certificate
from plcemu.verify.system import Timed

S = TypeVar("S", bound=Hashable)


def flaw_in(certificate: Certificate[S], system: Timed[S]) -> str:
    """Return what is wrong with a proof; empty if nothing is.

    If h(before) + q·units - p·batches >= h(after) for every move, then a run that starts n
    batches takes q·units >= p·n - (max h - min h): no schedule is faster than p/q in the long run.
    """
    p, q = certificate.period.numerator, certificate.period.denominator
    h, reached = certificate.potentials, set(system.initial())
    todo = list(reached)
    while todo:
        state = todo.pop()
        for move in system.moves(state):
            if state not in h or move.after not in h:
                return f"a state that can be reached has no potential: {move.after}"
            if h[state] + q * move.units - p * move.batches < h[move.after]:
                return f"a move is cheaper than the potentials allow: {move}"
            if move.after not in reached:
                reached.add(move.after)
                todo.append(move.after)
    cycle = certificate.cycle
    for taken, following in zip(cycle, [*cycle[1:], *cycle[:1]], strict=True):
        if taken.state not in reached or taken.move not in system.moves(taken.state) \
                or taken.move.after != following.state:
            return f"the cycle is no run of the system at {taken.state}"
    units, batches = (sum(getattr(t.move, what) for t in cycle) for what in ("units", "batches"))
    return "" if batches and q * units == p * batches else "the cycle has another ratio"
