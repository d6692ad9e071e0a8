"""How time is kept in a proof: by whole units or zones; whether that is exact, and why.

Whole units are exact for what is reached: all bounds are closed, so every run has one with the same
steps in which everything happens at whole units (Henzinger, Manna, Pnueli, What good are digital
clocks?, 1992). Zones are exact for any closed bounds, and for deadlocks too.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from fractions import Fraction
from typing import Any, Literal

from plant_sim.abstraction import Abstraction
from plant_sim.timed import in_time
from plcemu.base.errors import PlcemuError
from plcemu.base.time import format_duration
from plcemu.io.mapping import Point
from plcemu.ir.program import Program
from plcemu.verify.loop import Fairness
from plcemu.verify.machine import ScanMachine
from plcemu.verify.timed.clocks import lookout
from plcemu.verify.timed.loop import IntegerTime, TimedLoop
from plcemu.verify.timed.zones import ZoneTime

Time = Literal["auto", "integer", "zones"]

MANY_UNITS = 100
"""`auto` keeps time by whole units if the largest constant has no more of them."""


def timed_loop(time: Time, program: Program, kept: Collection[int] | None, machine: ScanMachine,
               plant: Abstraction, inputs: Sequence[Point], outputs: Sequence[Point],
               fairness: Fairness = "weak", *watching: Any) -> TimedLoop:
    """Return the closed loop in time.

    Args:
        time: how it is kept; `auto` takes whole units if the constants are small.
        kept: the bytes of memory that matter; None if all may.
        rest: as `ClosedLoop`.

    Raises:
        PlcemuError: a sensor is none of the plant's, or the program does more with elapsed times
            than to compare them with constants.
    """
    readings = plant.sense(next(iter(plant.initial())))
    lacking = [p.name for p in inputs if p.name not in readings]
    if lacking:
        raise PlcemuError(f"the program reads {', '.join(lacking)}, which the finite plant does "
                          "not tell")
    seen = lookout(program, kept)
    if seen.problems:
        told = "\n  ".join(seen.problems)
        raise PlcemuError("time cannot be treated exactly (merge: timed), since the program does "
                          "more with an elapsed time than to compare it with constants:\n  "
                          f"{told}\nVerify every scan instead: merge: none")
    arguments = (seen, machine, in_time(plant), inputs, outputs, fairness, *watching)
    if time == "zones":
        return ZoneTime(*arguments)
    loop = IntegerTime(*arguments)
    if time == "auto" and max(loop.largest, default=0) > MANY_UNITS:
        return ZoneTime(*arguments)
    return loop


def grounds(loop: TimedLoop, cycle_ns: int) -> list[str]:
    """Say how time is kept, why that is exact, and what is assumed."""
    asked = "; ".join(f"{c.name}: {', '.join(_time(Fraction(t)) for t in c.thresholds)}"
                      for c in loop.own if c.thresholds) or "none"
    how, why = _KINDS[type(loop)]
    exact = (f"{how.format(_time(loop.unit_ns))}; that is exact, since all bounds of the plant's "
             "clocks are closed, and the compiled program only asks whether elapsed times have "
             f"reached constants ({asked}): {why}")
    assumed = ("scans take no time: assumed is that the program comes to rest after each event "
               f"before time passes (its cycle is {format_duration(cycle_ns)}); events at one "
               "instant come in any order, or together")
    return [exact, assumed]


_KINDS: dict[type, tuple[str, str]] = {
    IntegerTime: ("time passes by whole units of {}, to the next instant at which anything can be",
                  "integer runs suffice then"),
    ZoneTime: ("time passes by any amount: clocks are kept as zones, in units of {}",
               "sets of clock values are bounded by differences then")}
"""How time is kept, and why that is exact."""


def _time(ns: Fraction) -> str:
    return format_duration(int(ns)) if ns.denominator == 1 else f"{ns} ns"
