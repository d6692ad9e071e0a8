"""What a plant step costs: advance to the next lap and read all sensors, beside naive peers.

    python benchmarks/plant_step.py

A step is 10 ms of plant time; a mean is over a whole run with all its events. The peers do the same
dynamics the usual way in the same process: a forward Euler step in plain Python, and
one call of scipy's solve_ivp over the step. Ratios count; absolute times depend on the machine.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

from scipy.integrate import solve_ivp

from plant_sim.batch_plant import BatchPlant
from plant_sim.evaporator import Evaporator

S, STEP_NS = 1_000_000_000, 10_000_000
LIMIT_US = 10.0


def per_step_us(steps: int, run: Callable[[], None], repeats: int = 5) -> float:
    """The best CPU time of one step, us."""
    best = math.inf
    for _ in range(repeats):
        begin = time.thread_time_ns()
        run()
        best = min(best, time.thread_time_ns() - begin)
    return best / steps / 1000


def evaporator_cycle() -> None:
    """66 s of the evaporator with the controller's switchings at their times."""
    plant = Evaporator()
    plant.watch(["T1E", "T1F", "T2E", "T2F", "Malf"])
    switchings: dict[int, dict[str, bool]] = {
        0: {"V1": True, "V2": True}, 67: {"V1": False, "V2": False}, 267: {"H": True},
        2267: {"H": False, "V3": True}, 2493: {"V3": False}, 5693: {"V4": True},
        6597: {"V4": False}}
    for n in range(6600):
        plant.advance(n * STEP_NS)
        plant.sense()
        if n in switchings:
            plant.actuate(switchings[n])


def batch_transfer() -> None:
    """Process P1 of the batch plant: 330 s, 84 changes of a level."""
    plant = BatchPlant({"tanks": "B1=sol42C"})
    plant.watch(["B1.level", "B3.level", "B3.concentration"])
    plant.actuate({"V8": True})
    for n in range(33_000):
        plant.advance(n * STEP_NS)
        plant.sense()


def euler() -> None:
    """The evaporator's four quantities in plain Python, one Euler step each lap."""
    state, k1, k2 = [1.0, 0.0, 100.0, 1.0], 0.2 * math.sqrt(2 * 9.80665), 0.05
    for _ in range(6600):
        out = k1 * math.sqrt(max(state[0], 0.0))
        rates = [-out, out - k2 * math.sqrt(max(state[1], 0.0)), -1.0, 0.1]
        state = [x + 0.01 * rate for x, rate in zip(state, rates, strict=True)]
        {"T1E": state[0] <= 0, "T1F": state[0] >= 1, "T2E": state[1] <= 0, "T2F": state[1] >= 1}


def solver() -> None:
    """The same by one call of solve_ivp a lap."""
    state: Any = [1.0, 0.0, 100.0, 1.0]
    k1, k2 = 0.2 * math.sqrt(2 * 9.80665), 0.05

    def rates(_: float, y: Any) -> list[float]:
        out = k1 * math.sqrt(max(y[0], 0.0))
        return [-out, out - k2 * math.sqrt(max(y[1], 0.0)), -1.0, 0.1]
    for _ in range(100):
        state = solve_ivp(rates, (0, 0.01), state).y[:, -1]


def main() -> None:
    """Measure and print a table."""
    base = per_step_us(6600, euler)
    print(f"{'':34}{'us a step':>12}{'x Euler':>10}")
    for name, steps, run in (("naive Euler step in Python", 6600, euler),
                             ("scipy solve_ivp a step", 100, solver),
                             ("evaporator, mean of a 66 s cycle", 6600, evaporator_cycle),
                             ("batch plant, mean of process P1", 33_000, batch_transfer)):
        cost = per_step_us(steps, run)
        verdict = "" if run in (euler, solver) else \
            f"   {'under' if cost < LIMIT_US else 'OVER'} {LIMIT_US:g} us"
        print(f"{name:34}{cost:12.2f}{cost / base:10.2f}{verdict}")


if __name__ == "__main__":
    main()
