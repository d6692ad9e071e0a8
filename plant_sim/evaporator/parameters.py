"""Parameters of the evaporator: Table 2 of the paper, and the durations of its section 2."""

from __future__ import annotations

from dataclasses import dataclass

from plant_sim.parameters import Parameters, parameter


def _duration(default_s: float, description: str, low: float = 0.001) -> float:
    value: float = parameter(default_s, description, unit="s", low=low, high=1e6)
    return value


def _size(default: float, description: str, unit: str, low: float, high: float) -> float:
    value: float = parameter(default, description, unit=unit, low=low, high=high)
    return value


@dataclass(frozen=True)
class EvaporatorParameters(Parameters):
    """What can be set on an evaporator; the first ten are the variables of Table 2."""

    Q1: float = _size(1.0, "flow through V1", "m3/s", 0.0, 1e3)
    Q2: float = _size(0.5, "flow through V2", "m3/s", 0.0, 1e3)
    G1: float = _size(1.0, "ground area of tank 1", "m2", 1e-3, 1e3)
    G2: float = _size(1.0, "ground area of tank 2", "m2", 1e-3, 1e3)
    Ht1: float = _size(1.0, "height of tank 1 at which it is full", "m", 1e-3, 1e3)
    Ht2: float = _size(1.0, "height of tank 2 at which it is full", "m", 1e-3, 1e3)
    A1: float = _size(0.2, "area of the drain hole of tank 1", "m2", 1e-6, 1e2)
    A2: float = _size(0.05, "area of the drain hole of tank 2", "m2", 1e-6, 1e2)
    g: float = _size(9.80665, "acceleration by gravity", "m/s2", 0.1, 100.0)
    brim: float = parameter(
        0.1, "room of each tank above full, as a part of its height", low=0.0, high=10.0
    )
    heat_up_s: float = _duration(0.0, "time from switching the heater on to steam", low=0.0)
    steam_after_s: float = _duration(12.0, "how long steam goes on after the heater is off")
    solid_after_s: float = _duration(19.0, "from the end of steam to solidification")
    burst_s: float = _duration(22.0, "steam without condenser until the condenser explodes")
    level_resolution_m: float = _size(0.01, "resolution of the level sensors", "m", 1e-4, 1.0)
