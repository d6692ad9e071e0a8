"""The report at the end of a run of the batch plant: batches, their period, what is left where."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from plant_sim.batch_plant.flows import SPILL
from plant_sim.batch_plant.layout import SOLUTION_L, TANKS, WATER_L
from plant_sim.batch_plant.loads import content_of
from plant_sim.batch_plant.tanks import BatchTanks

_SAME_NS, _SAME_PART = 1_000_000_000, 0.001
"""Two times between batches are the same if they differ by less than 1 s and 0.1 % together."""

_ROOMY_UNITS = 14
"""Units of solution and of water together with which the plant can still work (load 7)."""

_PATIENCE_S = 5000.0
"""A plant in which nothing has moved for longer than all durations of Table 1 together is stuck."""


def report_of(plant: BatchTanks) -> dict[str, Any]:
    """Summary of a run, ready for JSON; absent times are None."""
    numbers = plant.memory.numbers
    reason = why_nothing(plant)
    return {
        "t_s": plant.t_ns / 1e9,
        "batches": numbers["batches"],
        "first_batch_s": _seconds_or_none(numbers["first_batch_ns"]),
        "last_batch_s": _seconds_or_none(numbers["last_batch_ns"]),
        "period_s": period_s(plant.memory.series["batch_ns"]),
        "produces": not reason,
        "reason": reason,
        "stuck": is_stuck(plant),
        "initial": plant.initial_tanks(),
        "tanks": {tank.name: _contents(plant, tank.name) for tank in TANKS},
        "spilled_l": plant.units.litres(plant.volume(SPILL)),
        "spilled_salt_g": plant.units.grams(plant.salt(SPILL)),
        "forbidden_mixture": plant.memory.words["forbidden_mixture"] or None,
        "process_starts": len(plant.log) + numbers["log_dropped"],
        "process_starts_dropped": numbers["log_dropped"],
        "facts": plant.observe(),
    }


def period_s(starts_ns: Sequence[int]) -> float | None:
    """Long-run time per batch in s, from batch starts in ns; None for fewer than three.

    The times between batches settle into a pattern of k that repeats: the mean of its repetitions,
    for the least k that repeats at least twice and throughout the second half. Without such a k the
    mean of the second half.
    """
    gaps = [later - earlier for earlier, later in pairwise(starts_ns)]
    if len(gaps) < 2:
        return None
    for k in range(1, len(gaps) // 2 + 1):
        tail = gaps[-max(2 * k, len(gaps) // 2) :]
        if all(_same(a, b) for a, b in zip(tail, tail[k:], strict=False)):
            return _mean_s(tail[len(tail) % k :])
    return _mean_s(gaps[len(gaps) // 2 :])


def why_nothing(plant: BatchTanks) -> str:
    """Why the plant does not produce, in words; empty if it does."""
    numbers, stuck = plant.memory.numbers, is_stuck(plant)
    if numbers["batches"] and not stuck:
        return ""
    if stuck and numbers["moved_ns"]:
        cause = f"nothing has moved since {numbers['moved_ns'] / 1e9:g} s"
    elif plant.log:
        cause = "no mixed batch has left B3 yet"
    else:
        cause = "no process was ever started"
    return f"{cause}; {_stock(plant)}"


def is_stuck(plant: BatchTanks) -> bool:
    """Whether nothing moves, and nothing has moved for so long that nothing will."""
    idle_s = (plant.t_ns - plant.memory.numbers["moved_ns"]) / 1e9
    return not plant.memory.flags["moves"] and idle_s > _PATIENCE_S


def _stock(plant: BatchTanks) -> str:
    """What the plant started with, and whether it is too little or too much."""
    contents = [content_of(word) for word in plant.initial_tanks().values()]
    salt_g = sum(c.volume_l * c.concentration_g_l for c in contents)
    solution = salt_g / (5 * SOLUTION_L)
    water = (sum(c.volume_l for c in contents) - solution * SOLUTION_L) / WATER_L
    amounts = f"{float(solution):g} units of solution and {float(water):g} of water"
    if min(solution, water) < 1:
        return f"{amounts} do not make one batch"
    if solution + water > _ROOMY_UNITS:
        return f"{amounts} leave too little room to move"
    return f"it started with {amounts}"


def _contents(plant: BatchTanks, tank: str) -> dict[str, float]:
    return {
        "level_l": plant.units.litres(plant.volume(tank)),
        "salt_g": plant.units.grams(plant.salt(tank)),
        "concentration_g_l": float(plant.concentration_g_l(tank)),
        "temperature_degC": float(plant.temperature_degC(tank)),
    }


def _same(a_ns: int, b_ns: int) -> bool:
    return abs(a_ns - b_ns) <= _SAME_NS + _SAME_PART * max(a_ns, b_ns)


def _mean_s(gaps_ns: Sequence[int]) -> float:
    return sum(gaps_ns) / (len(gaps_ns) * 1_000_000_000)


def _seconds_or_none(t_ns: int) -> float | None:
    return t_ns / 1e9 if t_ns >= 0 else None
