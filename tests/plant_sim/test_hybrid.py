"""What all hybrid plants share, on a toy: a kettle with a float switch and a set flow."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar

import pytest

from plant_sim import Fact, FactValue, Parameters, Port
from plant_sim.hybrid import Guard, HybridPlant, Timer, ZenoError
from plant_sim.lines import Form, exact
from plant_sim.readings import Reading, Rounding

PORTS = (
    Port("float", "sensor", "bool", "", 0, 1, 1, "on from 10 drops"),
    Port("level", "sensor", "real", "drop", 0, 20, 2.5, "level"),
    Port("inflow", "actuator", "real", "drop/ns", -3.0, 3.0, 0.5, "inflow"),
    Port("stir", "actuator", "bool", "", 0, 1, 1, "a stirrer that upsets the model"),
)
READINGS = {
    "float": Reading(Form((("drops", 1),), -9), Form((), 100), Rounding.CEILING, low=0, high=1),
    "level": Reading(Form((("drops", 2),)), Form((), 5), Rounding.CEILING, low=0, high=8),
}


@dataclass(frozen=True)
class NoParameters(Parameters):
    """A toy has none."""


class Kettle(HybridPlant):
    """Fills at the set flow up to 20 drops; whistles 5 ns later."""

    name: ClassVar[str] = "kettle"

    def __init__(self) -> None:
        facts = [Fact("whistles", "bool", "", "full for 5 ns")]
        super().__init__(NoParameters(), PORTS, facts, READINGS)

    def _begin(self) -> dict[str, int]:
        self.memory.flags.update(full=False, whistles=False)
        self.memory.numbers["whistle_ns"] = -1
        return {"drops": 0}

    def _settle(self, fired: frozenset[str]) -> None:
        if "full" in fired:
            self.memory.flags["full"] = True
            self.memory.numbers["whistle_ns"] = self.t_ns + 5
        self.memory.flags["whistles"] |= "whistle" in fired
        flow = Fraction(0) if self.memory.flags["full"] else exact(self.actuators["inflow"])
        self._slope("drops", flow)

    def _guards(self) -> Iterable[Guard]:
        if self.actuators["stir"]:
            yield Guard("upset", Form((("drops", 1),)))
        if not self.memory.flags["full"]:
            yield Guard("full", Form((("drops", 1),), -20))

    def _timers(self) -> Iterable[Timer]:
        if self.memory.numbers["whistle_ns"] > self.t_ns:
            yield Timer("whistle", self.memory.numbers["whistle_ns"])

    def _observe(self) -> dict[str, FactValue]:
        return {"whistles": self.memory.flags["whistles"]}

    def report(self) -> dict[str, Any]:
        return self.observe()


def test_real_actuators_bool_sensors_and_timers_work_together() -> None:
    kettle = Kettle()
    kettle.actuate({"inflow": 0.0})
    kettle.advance(100)
    kettle.actuate({"inflow": 2.0})
    kettle.watch(["float"])
    assert kettle.sense() == {"float": False}
    assert kettle.next_event_ns() == 105
    kettle.advance(105)
    assert kettle.sense() == {"float": True}
    assert kettle.next_event_ns() == 115
    kettle.advance(1000)
    kettle.watch()
    assert kettle.sense() == {"float": True, "level": 20.0}
    assert kettle.counts() == {"float": 1, "level": 8}
    assert kettle.observe() == {"whistles": True}
    assert kettle.next_event_ns() is None


def test_a_model_that_never_settles_is_reported_and_does_not_hang() -> None:
    with pytest.raises(ZenoError, match="kettle never settles at 0 ns"):
        Kettle().actuate({"stir": True})
