"""Ports, readings and facts of the batch plant."""

from __future__ import annotations

import math
from collections.abc import Iterator

from plant_sim.batch_plant.layout import (
    ACTUATORS,
    COLD_DEGC,
    LEAK_HIGH_L_S,
    LEAKS,
    NO_COOLANT,
    NO_HEAT,
    PUMPS,
    TANKS,
    WEARS,
)
from plant_sim.batch_plant.parameters import BatchParameters
from plant_sim.batch_plant.units import FINE, Units
from plant_sim.contract import Fact, Port
from plant_sim.lines import Form, exact
from plant_sim.readings import Reading, Rounding

TEMPERATURE_HIGH_DEGC = 120.0
CONCENTRATION_HIGH_G_L = 50.0


def ports_of(parameters: BatchParameters, units: Units) -> tuple[Port, ...]:
    """Three sensors a tank, then all actuators, then the disturbances."""
    sensors = []
    for tank in TANKS:
        brim_l = float(units.brims_l[tank.name])
        rows = (
            ("level", "l", brim_l, parameters.level_resolution_l),
            ("temperature", "degC", TEMPERATURE_HIGH_DEGC, parameters.temperature_resolution_degC),
            (
                "concentration",
                "g/l",
                CONCENTRATION_HIGH_G_L,
                parameters.concentration_resolution_g_l,
            ),
        )
        for what, unit, high, step in rows:
            text = f"{what} of {tank.name} ({tank.purpose})"
            sensors.append(
                Port(f"{tank.name}.{what}", "sensor", "real", unit, 0.0, high, step, text)
            )
    actuators = [
        Port(name, "actuator", "bool", "", 0.0, 1.0, 1.0, text) for name, text in ACTUATORS.items()
    ]
    return (*sensors, *actuators, *_disturbances())


def _disturbances() -> Iterator[Port]:
    for tank, name in LEAKS.items():
        text = f"hole in {tank}"
        yield Port(name, "disturbance", "real", "l/s", 0.0, LEAK_HIGH_L_S, 0.001, text)
    for name, pump in WEARS.items():
        text = f"part of its flow that {pump} does not give"
        yield Port(name, "disturbance", "real", "", 0.0, 1.0, 0.01, text)
    for name, text in ((NO_COOLANT, "no coolant comes"), (NO_HEAT, "the heater does not heat")):
        yield Port(name, "disturbance", "bool", "", 0.0, 1.0, 1.0, text)


def readings_of(parameters: BatchParameters, units: Units) -> dict[str, Reading]:
    """How each sensor reads the volume, salt and heat of its tank.

    Level and temperature are rounded up, so that 0 is an empty tank, a drained unit shows as soon
    as it is out, and 20 degC is fully cooled. Concentration is rounded to the nearest, so that a
    trace too much of a component does not show. An empty tank reads 20 degC and 0 g/l.
    """
    level = exact(parameters.level_resolution_l)
    degree = exact(parameters.temperature_resolution_degC)
    strength = exact(parameters.concentration_resolution_g_l)
    readings: dict[str, Reading] = {}
    for name, brim_l in units.brims_l.items():
        volume, salt, heat = f"{name}.volume", f"{name}.salt", f"{name}.heat"
        readings[f"{name}.level"] = Reading(
            Form(((volume, level.denominator),)),
            Form((), level.numerator * units.per_litre),
            Rounding.CEILING,
            low=0,
            high=math.ceil(brim_l / level),
        )
        readings[f"{name}.temperature"] = Reading(
            Form(((heat, degree.denominator), (volume, COLD_DEGC * FINE * degree.denominator))),
            Form(((volume, FINE * degree.numerator),)),
            Rounding.CEILING,
            low=0,
            high=math.ceil(exact(TEMPERATURE_HIGH_DEGC) / degree),
            undefined=math.ceil(COLD_DEGC / degree),
        )
        readings[f"{name}.concentration"] = Reading(
            Form(((salt, strength.denominator),)),
            Form(((volume, FINE * strength.numerator),)),
            Rounding.NEAREST,
            low=0,
            high=math.floor(exact(CONCENTRATION_HIGH_G_L) / strength),
        )
    return readings


FACTS: tuple[Fact, ...] = (
    Fact("batches", "int", "", "transfers of a mixed batch from B3 to B4 that were started"),
    Fact("first_batch_s", "real", "s", "start of the first such transfer; -1 before it"),
    Fact("last_batch_s", "real", "s", "start of the latest such transfer; -1 before the first"),
    Fact("overflow", "bool", "", "some tank has overflowed"),
    *(Fact(f"{tank.name}.overflow", "bool", "", f"{tank.name} has overflowed") for tank in TANKS),
    Fact("forbidden_mixture", "bool", "", "a liquid went where it must not"),
    Fact("B5.dry_heating", "bool", "", "the heater was on while B5 was empty"),
    *(Fact(f"{pump}.dry", "bool", "", f"{pump} ran dry") for pump in PUMPS),
    *(Fact(f"{pump}.blocked", "bool", "", f"{pump} ran against a closed path") for pump in PUMPS),
)
