"""Parameters of the batch plant: durations of Table 1, sensors, and the initial contents."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from plant_sim.batch_plant.loads import CONTENTS, read_tanks
from plant_sim.parameters import ParameterError, Parameters, parameter

_LOADS = tuple(halves / 2 for halves in range(17))


def _duration(default_s: float, description: str) -> float:
    value: float = parameter(default_s, description, unit="s", low=1.0, high=1e6)
    return value


def _resolution(default: float, what: str, unit: str, high: float) -> float:
    text = f"resolution of the {what} sensors"
    value: float = parameter(default, text, unit=unit, low=0.001, high=high)
    return value


@dataclass(frozen=True)
class BatchParameters(Parameters):
    """What can be set on a batch plant; times in s, volumes in l."""

    load: float = parameter(
        2.0,
        "batches of solution and water that the plant starts with, filled in from the top",
        allowed=_LOADS,
        expects="0 to 8 in steps of 0.5",
    )
    half: str = parameter(
        "solution", "what the half of a load n.5 consists of", allowed=("solution", "water")
    )
    tanks: Mapping[str, str] = parameter(
        {},
        "initial contents instead of load: TANK=CONTENT,...; tanks left out are empty; "
        + "; ".join(f"{tank}: {'|'.join(allowed)}" for tank, allowed in CONTENTS.items()),
        expects="TANK=CONTENT,...",
        read=read_tanks,
    )
    B1_B3_s: float = _duration(320.0, "one unit of solution from B1 to B3")
    B2_B3_s: float = _duration(240.0, "one unit of water from B2 to B3")
    B3_B4_s: float = _duration(600.0, "one mixed batch from B3 to B4")
    B4_B5_s: float = _duration(330.0, "one mixed batch from B4 to B5")
    heat_B5_s: float = _duration(1470.0, "heating up B5 and evaporating one unit of water")
    heat_up_s: float = _duration(270.0, "heating up B5 alone, part of heat_B5_s")
    B5_B7_s: float = _duration(260.0, "one unit of solution from B5 to B7")
    cool_B6_s: float = _duration(300.0, "cooling B6 to 20 degC from any temperature")
    cool_B7_s: float = _duration(600.0, "cooling B7 to 20 degC from any temperature")
    B6_B2_s: float = _duration(240.0, "one unit of water from B6 to B2")
    B7_B1_s: float = _duration(220.0, "one unit of solution from B7 to B1")
    brim_l: float = parameter(
        0.5, "room of each tank above its nominal capacity", unit="l", low=0.0, high=10.0
    )
    pump_grace_s: float = parameter(
        1.0, "how long a pump may run dry or blocked before it counts", unit="s", low=0.0, high=1e6
    )
    level_resolution_l: float = _resolution(0.1, "level", "l", 2.0)
    temperature_resolution_degC: float = _resolution(1.0, "temperature", "degC", 20.0)
    concentration_resolution_g_l: float = _resolution(0.1, "concentration", "g/l", 1.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.heat_up_s >= self.heat_B5_s:
            expected = f"less than heat_B5_s, {self.heat_B5_s:g} s"
            raise ParameterError("heat_up_s", self.heat_up_s, expected)
