"""The batch plant's controller as the paper draws it, run with the fixed durations of its Table 1.

An independent discrete-event simulation to judge the real program and the real plant by. Source:
Brinksma, Mader and Fehnker, "Verification and Optimization of a PLC Control Schedule", Figures 6
(fill), 7 (conflicts) and 8 (priority), Table 1 (seconds). Tanks hold symbols; a transfer makes both
its tanks undefined while it runs. At each instant all ends come before all starts, and starts are
evaluated together, again and again until none is left.
"""

from __future__ import annotations

from itertools import count
from typing import NamedTuple

Tanks = dict[str, str]

UNDEFINED = "undefined"
SECONDS = {1: 320, 2: 240, 3: 320, 4: 240, 5: 600, 6: 330, 7: 1470}
SECONDS |= {8: 260, 9: 600, 10: 300, 11: 220, 12: 240}

SOL, WATER, COLD = ("sol42C", "sol84C"), ("water28C", "water56C"), "C"
MINUS_ONE = {"sol42": "empty", "sol84": "sol42", "water28": "empty", "water56": "water28"}
MINUS_ONE |= {"sol70": "empty", "sol140": "sol70"}
PLUS_ONE = {("empty", "sol42"): "sol42", ("sol42", "sol42"): "sol84"}
PLUS_ONE |= {("empty", "water28"): "water28", ("water28", "water28"): "water56"}
PLUS_ONE |= {("empty", "sol70"): "sol70", ("sol70", "sol70"): "sol140"}
PLUS_ONE |= {("water28", "sol42"): "sol70", ("sol42", "water28"): "sol70"}

# Figure 6: (tank, admissible contents) twice for each process.
FILL: dict[int, tuple[tuple[str, tuple[str, ...]], ...]] = {
    1: (("B1", SOL), ("B3", ("empty",))),
    2: (("B2", WATER), ("B3", ("empty",))),
    3: (("B1", SOL), ("B3", ("water28C",))),
    4: (("B2", WATER), ("B3", ("sol42C",))),
    5: (("B3", ("sol70C",)), ("B4", ("empty", "sol70C"))),
    6: (("B4", ("sol70C", "sol140C")), ("B5", ("empty",))),
    7: (("B5", ("sol70C",)), ("B6", ("empty", "water28C", "water28H"))),
    8: (("B5", ("sol42H",)), ("B7", ("empty", "sol42C", "sol42H"))),
    9: (("B7", ("sol42H", "sol84H")),),
    10: (("B6", ("water28H", "water56H")),),
    11: (("B7", SOL), ("B1", ("empty", "sol42C"))),
    12: (("B6", WATER), ("B2", ("empty", "water28C"))),
}
UNIT = {1: "sol42", 2: "water28", 3: "sol42", 4: "water28", 5: "sol70", 6: "sol70"}
UNIT |= {8: "sol42", 11: "sol42", 12: "water28"}

# Figure 7: processes that must not be active.
CONFLICTS = {
    **dict.fromkeys((1, 3), (2, 4, 5, 11)),
    **dict.fromkeys((2, 4), (1, 3, 5, 12)),
    5: (1, 2, 3, 4, 6),
    6: (5, 7, 8),
    7: (6, 8, 10, 12),
    8: (6, 7, 9, 11),
    9: (8, 11),
    10: (7, 12),
    11: (1, 3, 8, 9),
    12: (2, 4, 7, 10),
}

# Figure 8 in its order of evaluation: processes whose start goes first.
PRIORITY = {7: (), 8: (7,), 6: (7, 8), 5: (6,), 1: (5,), 3: (5,), 2: (1, 3, 5), 4: (1, 3, 5)}
PRIORITY |= {9: (8,), 10: (7,), 11: (1, 3, 8, 9), 12: (2, 4, 7, 10)}


class Outcome(NamedTuple):
    """Starts as (s, process), starts of batches in s, and the exact long-run s per batch."""

    starts: list[tuple[int, int]]
    batches_s: list[int]
    period_s: float | None


def startable(tanks: Tanks, active: dict[int, int]) -> list[int]:
    """The processes whose Theta holds, by number."""
    theta: list[int] = []
    for process, first in PRIORITY.items():
        fill = all(tanks[tank] in words for tank, words in FILL[process])
        free = active.keys().isdisjoint(CONFLICTS[process])
        if fill and free and process not in active and not set(first) & set(theta):
            theta.append(process)
    return sorted(theta)


def results(process: int, tanks: Tanks) -> Tanks:
    """Contents of the process's tanks after it, from those before it."""
    (source, _), *rest = FILL[process]
    if process in (9, 10):
        return {source: tanks[source][:-1] + COLD}
    sink = rest[0][0]
    if process == 7:
        return {"B5": "sol42H", "B6": _add(tanks["B6"], "water28", hot=True)}
    left = MINUS_ONE[tanks[source][:-1]]
    after = "empty" if left == "empty" else left + tanks[source][-1]
    return {source: after, sink: _add(tanks[sink], UNIT[process], hot=process == 8)}


def _add(content: str, unit: str, hot: bool) -> str:
    held = content if content == "empty" else content[:-1]
    return PLUS_ONE[held, unit] + ("H" if hot else COLD)


def simulate(initial: Tanks, batches: int = 60) -> Outcome:
    """Run from these contents (tanks left out are empty) until so many batches or a standstill."""
    tanks = {f"B{i}": "empty" for i in range(1, 8)} | initial
    active: dict[int, int] = {}
    after: dict[int, Tanks] = {}
    starts: list[tuple[int, int]] = []
    batches_s: list[int] = []
    seen: dict[object, tuple[int, int]] = {}
    period = None
    t_s = 0
    for _ in count():
        for process in [p for p, end in active.items() if end == t_s]:
            del active[process]
            tanks |= after.pop(process)
        while chosen := startable(tanks, active):
            for process in chosen:
                active[process], after[process] = t_s + SECONDS[process], results(process, tanks)
                tanks |= dict.fromkeys(after[process], UNDEFINED)
                starts.append((t_s, process))
            batches_s += [t_s] * (5 in chosen)
        left = sorted((p, end - t_s, *sorted(after[p].items())) for p, end in active.items())
        state = (*tanks.values(), *left)
        if state in seen and period is None:
            t0_s, n0 = seen[state]
            period = (t_s - t0_s) / (len(batches_s) - n0) if len(batches_s) > n0 else None
        seen.setdefault(state, (t_s, len(batches_s)))
        if not active or len(batches_s) >= batches:
            return Outcome(starts, batches_s, period)
        t_s = min(active.values())
    raise AssertionError("unreachable")
