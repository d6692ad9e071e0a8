"""The conveyor as a linear hybrid automaton: all that it can do, for exact reachability.

The speed v is constant in a run but not known, so position = v · time is a product of two
unknowns. Measured in times it is linear again: `tau` is the time since the motor started and `y`
the time since the limit switch was reached, negative before. As the switch stands at s,
v = s / (tau - y), and the conveyor stops at s · tau / (tau - y). Times in s, positions in mm.

The duration of the way back is left open here (any time), which allows more than the plant can
do. Nothing is lost: no more is reached before the first stop, and every run after a return begins
as the first one did.
"""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

from plant_sim.linear_automaton import Automaton, location, objective, transition

if TYPE_CHECKING:
    from plant_sim.conveyor.plant import ConveyorParameters


def automaton(parameters: ConveyorParameters) -> Automaton:
    """Return what a conveyor with these parameters can do."""
    way = Fraction(str(parameters.test_mm))
    speed = Fraction(str(parameters.speed_mm_s))
    deviation = Fraction(str(parameters.perturbation_pct)) / 100
    soonest, latest = way / (speed * (1 + deviation)), way / (speed * (1 - deviation))
    return Automaton(
        locations=(
            location("load", {}, readings=[("", {"load_pos": True})]),
            location("moving", {"tau": 1, "y": 1}, readings=[("y >= 0", {"test_pos": True})]),
            location("testing", {}, readings=[("", {"test_pos": True})]),
            location("tested", {}, readings=[("", {"test_pos": True, "test_done": True})]),
            location("returning", {}),
        ),
        transitions=(
            transition("load", "moving", sets={"tau": 0, "y": (-latest, -soonest)},
                       command={"go_to_test": True, "go_back": False}),
            transition("moving", "testing", command={"go_to_test": False, "go_back": False}),
            transition("testing", "tested"),
            transition("testing", "returning", command={"go_to_test": False, "go_back": True}),
            transition("tested", "returning", command={"go_to_test": False, "go_back": True}),
            transition("returning", "load"),
        ),
        initial="load", start=(),
        objectives=(objective("stop", "testing", f"{way}*tau", "tau - y", unit="mm"),))
