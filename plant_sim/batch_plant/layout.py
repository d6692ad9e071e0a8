"""The pipework of the batch plant as tables: tanks, transfers, coolers, actuators, tolerances.

Source of all numbers: Brinksma, Mader and Fehnker, "Verification and Optimization of a PLC Control
Schedule", section 2.1 (units of liquid), Table 1 (durations) and Figure 4 (valves of each process).
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Literal, NamedTuple

Liquid = Literal["solution", "water", "mixed"]

SOLUTION_L = Fraction(42, 10)
"""One unit of concentrated solution, l."""
WATER_L = Fraction(28, 10)
"""One unit of water, l."""
MIXED_L = SOLUTION_L + WATER_L
"""One mixed batch, l."""

COLD_DEGC = 20
BOILING_DEGC = 100

CONCENTRATION_G_L: dict[Liquid, Fraction] = {
    "solution": Fraction(5),
    "water": Fraction(0),
    "mixed": Fraction(3),
}
"""Salt in the three liquids of the plant, g/l."""

TOLERANCE_G_L: dict[Liquid, Fraction] = {
    "solution": Fraction(25, 100),
    "water": Fraction(15, 100),
    "mixed": Fraction(15, 100),
}
"""How far, in g/l, a liquid may be off and still be that liquid; 5 % for the two with salt."""

MIXED_TOLERANCE_L = Fraction(3, 10)
"""How far the level of a mixed batch in B3 may be off, l."""


class Tank(NamedTuple):
    """A tank and what it can hold up to its nominal level."""

    name: str
    capacity_l: Fraction
    purpose: str


TANKS: tuple[Tank, ...] = (
    Tank("B1", 2 * SOLUTION_L, "store of solution"),
    Tank("B2", 2 * WATER_L, "store of water"),
    Tank("B3", MIXED_L, "mixer"),
    Tank("B4", 2 * MIXED_L, "store of mixed batches"),
    Tank("B5", MIXED_L, "evaporator"),
    Tank("B6", 2 * WATER_L, "condensate"),
    Tank("B7", 2 * SOLUTION_L, "concentrate"),
)


@dataclass(frozen=True, slots=True)
class Transfer:
    """Liquid flows from source to sink while all `actuators` are on and the source is not empty.

    `duration` names the parameter with the seconds that one unit takes; `carries` is the liquid
    that belongs in this pipe; `process` is the process of the paper that the flow is, and
    `process_second` the one it is when the sink already holds the other component.
    """

    name: str
    source: str
    sink: str
    actuators: tuple[str, ...]
    unit_l: Fraction
    duration: str
    carries: Liquid
    process: str
    process_second: str = ""


_PUMP1_PATH = ("V18", "V23", "V22", "V1", "V3", "Pump1")
_PUMP2_PATH = ("V20", "V24", "V25", "V5", "V6", "Pump2")

TRANSFERS: tuple[Transfer, ...] = (
    Transfer("B1-B3", "B1", "B3", ("V8",), SOLUTION_L, "B1_B3_s", "solution", "P1", "P3"),
    Transfer("B2-B3", "B2", "B3", ("V9",), WATER_L, "B2_B3_s", "water", "P2", "P4"),
    Transfer("B3-B4", "B3", "B4", ("V11",), MIXED_L, "B3_B4_s", "mixed", "P5"),
    Transfer("B4-B5", "B4", "B5", ("V12",), MIXED_L, "B4_B5_s", "mixed", "P6"),
    Transfer("B5-B7", "B5", "B7", ("V15",), SOLUTION_L, "B5_B7_s", "solution", "P8"),
    Transfer("B7-B1", "B7", "B1", _PUMP1_PATH, SOLUTION_L, "B7_B1_s", "solution", "P11"),
    Transfer("B6-B2", "B6", "B2", _PUMP2_PATH, WATER_L, "B6_B2_s", "water", "P12"),
)
"""Every tank is the source of at most one transfer."""

MIXER_TANK = "B3"


class Cooler(NamedTuple):
    """A cooled tank, its coolant valve, the parameter with its duration, and its process."""

    tank: str
    valve: str
    duration: str
    process: str


COOLERS: tuple[Cooler, ...] = (
    Cooler("B7", "V17", "cool_B7_s", "P9"),
    Cooler("B6", "V29", "cool_B6_s", "P10"),
)

HEATED, CONDENSATE = "B5", "B6"
"""The heater boils B5; its steam condenses into B6 (process P7)."""

PUMPS: dict[str, Transfer] = {
    pump: transfer
    for transfer in TRANSFERS
    for pump in transfer.actuators
    if pump.startswith("Pump")
}

ACTUATORS: dict[str, str] = {
    **{a: f"valve {t.source} to {t.sink}" for t in TRANSFERS for a in t.actuators},
    "V17": "coolant valve of B7",
    "V29": "coolant valve of B6",
    "Mixer": "stirrer of B3",
    "Heater": "heater of B5",
    "Pump1": "pump B7 to B1",
    "Pump2": "pump B6 to B2",
}
"""Actuator -> what it is."""

LEAKS: dict[str, str] = {tank.name: f"{tank.name}.leak" for tank in TANKS}
"""Tank -> its disturbance: a hole, with its flow in l/s."""

LEAK_HIGH_L_S = 0.5

WEARS: dict[str, str] = {f"{pump}.worn": pump for pump in PUMPS}
"""Disturbance -> pump: the part of its flow that a worn pump no longer gives."""

NO_COOLANT, NO_HEAT = "Coolant.failed", "Heater.failed"
"""Disturbances: no coolant comes; the heater does not heat."""
