"""The evaporator as a hybrid automaton.

Two tanks one above the other. Levels obey Torricelli's law, as in the paper's Modelica model
(Figure 6): area * height * level' = q_in - q_out, q_out = hole * sqrt(2 g * height * level); here
levels are in m. Modelling choices beside the paper:

* The solution of tank 1 has a temperature: 100 degC where it boils, 88 degC where steam ends, 69
  degC where the concentrate becomes solid. It cools evenly between these, so that the durations
  of section 2 (12 s, then 19 s) are those of the temperatures, whenever the heater goes off.
* Fresh solution cannot become solid; what has been boiled can. A solid does not drain.
* Steam under a failed condenser raises the pressure evenly, from 1 bar to 3.2 bar in 22 s; what
  has gathered stays until the condenser works again, then it goes as fast as it came.
* What evaporates is too little to change the level.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from plant_sim.automaton import (
    Guard,
    HybridAutomaton,
    Linear,
    Mode,
    Ode,
    Torricelli,
    actuator,
    disturbance,
    falls,
    gauge,
    rises,
    switch,
)
from plant_sim.contract import Fact, Port
from plant_sim.curves import Caught, Law
from plant_sim.evaporator.parameters import EvaporatorParameters
from plant_sim.gauges import Sensor

AMBIENT_DEGC, SOLID_DEGC, STEAM_DEGC, BOILING_DEGC = 20.0, 69.0, 88.0, 100.0
NORMAL_BAR, BURST_BAR = 1.0, 3.2
LEAK_HIGH_M2 = 0.1


@dataclass(frozen=True, slots=True)
class Hole:
    """What flows out of a tank: k in sqrt(m) / s, and the part of it that goes where it should."""

    k: float
    kept: float


class Evaporator(HybridAutomaton):
    """Tank 1 with heater and mixer, tank 2 below it, a condenser for the steam."""

    name: ClassVar[str] = "evaporator"
    parameter_type = EvaporatorParameters
    parameters: EvaporatorParameters

    def elements(self) -> Iterable[Port | Sensor | Fact]:
        """Sensors and actuators of Table 1, transmitters for the figures, hazards as facts."""
        p = self.parameters
        for n, height in ((1, p.Ht1), (2, p.Ht2)):
            level = f"tank{n}.level"
            yield switch(f"T{n}E", f"tank {n} is empty", of=level, at_most=0.0)
            yield switch(f"T{n}F", f"tank {n} is full", of=level, at_least=height)
            yield gauge(level, f"level of tank {n}", "m", high=2 * height + p.level_resolution_m,
                        resolution=p.level_resolution_m)
            yield disturbance(f"tank{n}.leak", f"hole in tank {n}", "m2", high=LEAK_HIGH_M2)
            yield Fact(f"tank{n}.overflow", "bool", "", f"tank {n} has overflowed")
        yield switch("Malf", "the condenser fails")
        yield gauge("tank1.temperature", "solution in tank 1", "degC", high=120, resolution=0.5)
        yield gauge("condenser.pressure", "pressure in the condenser", "bar", high=4.0,
                    resolution=0.05)
        yield disturbance("condenser.malfunction", "the condenser does not cool")
        for n, what in enumerate(("inlet of the first solution", "inlet of the second solution",
                                  "from tank 1 to tank 2", "outlet of tank 2"), 1):
            yield actuator(f"V{n}", f"valve: {what}")
        yield actuator("H", "heater of tank 1")
        yield actuator("MR", "mixer of tank 1")
        yield actuator("Alarm", "alarm")
        yield Fact("steam", "bool", "", "steam goes from tank 1 into the condenser")
        yield Fact("explosion", "bool", "", "the condenser has exploded")
        yield Fact("solidified", "bool", "", "the solution in tank 1 has become solid")
        yield Fact("dry_heating", "bool", "", "the heater was on while tank 1 was empty")

    def begin(self) -> Mapping[str, Any]:
        """Empty and cold."""
        return {
            "tank1.level": 0.0, "tank2.level": 0.0, "tank1.temperature": AMBIENT_DEGC,
            "condenser.pressure": NORMAL_BAR, "Malf": False, "concentrated": False,
            "steam": False, "explosion": False, "solidified": False, "dry_heating": False,
            "tank1.overflow": False, "tank2.overflow": False,
        }

    def mode(self, x: dict[str, Any], on: Mapping[str, Any]) -> Mode:
        """How levels, temperature and pressure go on."""
        news = self._at_once(x, on)
        if news:
            return Mode(now=news)
        flows = {**self._levels(x, on), **self._thermal(x, on), **self._pressure(x)}
        return Mode(flows, tuple(self._ends(x)))

    # What is so at once

    def _at_once(self, x: dict[str, Any], on: Mapping[str, Any]) -> dict[str, Any]:
        wet, temperature = x["tank1.level"] > 0, x["tank1.temperature"]
        news: dict[str, Any] = {"Malf": on["condenser.malfunction"]}
        if on["H"] and wet and not self.parameters.heat_up_s:
            news["tank1.temperature"] = temperature = BOILING_DEGC
        if not wet:
            news |= {"tank1.temperature": AMBIENT_DEGC, "concentrated": False}
            temperature = AMBIENT_DEGC
        news["steam"] = wet and temperature > STEAM_DEGC
        if news["steam"]:
            news["concentrated"] = True
        if self._is_solid(x):
            news["solidified"] = True
        if on["H"] and not wet:
            news["dry_heating"] = True
        if x["condenser.pressure"] >= BURST_BAR:
            news |= {"explosion": True, "condenser.pressure": NORMAL_BAR}
        for n, net in self._net(x, on).items():
            if x[f"tank{n}.level"] >= self._brim(n) and net > 0:
                news[f"tank{n}.overflow"] = True
        return {name: value for name, value in news.items() if x[name] != value}

    @staticmethod
    def _is_solid(x: Mapping[str, Any]) -> bool:
        return bool(x["concentrated"] and x["tank1.level"] > 0
                    and x["tank1.temperature"] <= SOLID_DEGC)

    # Levels

    def _brim(self, n: int) -> float:
        p = self.parameters
        return (p.Ht1, p.Ht2)[n - 1] * (1 + p.brim)

    def _hole(self, n: int, x: Mapping[str, Any], on: Mapping[str, Any]) -> Hole:
        """The holes of a tank together."""
        p = self.parameters
        area, ground = ((p.A1, p.G1), (p.A2, p.G2))[n - 1]
        is_open = on[("V3", "V4")[n - 1]] and not (n == 1 and self._is_solid(x))
        valve, leak = area if is_open else 0.0, float(on[f"tank{n}.leak"])
        whole = valve + leak
        return Hole(whole * math.sqrt(2 * p.g) / ground, valve / whole if whole else 0.0)

    def _inflow(self, on: Mapping[str, Any]) -> float:
        """What comes into tank 1, in m of its level per s."""
        p = self.parameters
        return ((p.Q1 if on["V1"] else 0.0) + (p.Q2 if on["V2"] else 0.0)) / p.G1

    def _net(self, x: Mapping[str, Any], on: Mapping[str, Any]) -> dict[int, float]:
        """How fast each level would rise now without a brim, m/s."""
        p = self.parameters
        roots = [math.sqrt(max(x[f"tank{n}.level"], 0.0)) for n in (1, 2)]
        hole1, hole2 = self._hole(1, x, on), self._hole(2, x, on)
        given = hole1.k * roots[0] * hole1.kept * p.G1 / p.G2
        return {1: self._inflow(on) - hole1.k * roots[0], 2: given - hole2.k * roots[1]}

    def _levels(self, x: Mapping[str, Any], on: Mapping[str, Any]) -> dict[str, Law]:
        net, hole1, hole2 = self._net(x, on), self._hole(1, x, on), self._hole(2, x, on)
        inflow, share = self._inflow(on), hole1.kept * self.parameters.G1 / self.parameters.G2
        runs_over = {n: x[f"tank{n}.level"] >= self._brim(n) and net[n] > 0 for n in (1, 2)}
        flows: dict[str, Law] = {}
        if not runs_over[1]:
            flows |= self._level("tank1.level", x, inflow, hole1.k)
        if runs_over[2]:
            return flows
        drains = isinstance(flows.get("tank1.level"), Torricelli)
        if not (share and hole1.k and (x["tank1.level"] > 0 or inflow)):
            flows |= self._level("tank2.level", x, 0.0, hole2.k)
        elif drains and not hole2.k:
            flows["tank2.level"] = Caught(share, Torricelli(hole1.k), float(x["tank1.level"]))
        else:
            flows["tank2.level"] = Ode(_both(share * hole1.k, hole2.k))
        return flows

    @staticmethod
    def _level(level: str, x: Mapping[str, Any], inflow: float, k: float) -> dict[str, Law]:
        if inflow and k:
            return {level: Ode(lambda state: inflow - k * math.sqrt(max(state[level], 0.0)))}
        if inflow:
            return {level: Linear(inflow)}
        return {level: Torricelli(k)} if k and x[level] > 0 else {}

    # Heat and pressure

    def _thermal(self, x: Mapping[str, Any], on: Mapping[str, Any]) -> dict[str, Law]:
        p, temperature = self.parameters, x["tank1.temperature"]
        if not x["tank1.level"] > 0:
            return {}
        if on["H"]:
            heats = p.heat_up_s and temperature < BOILING_DEGC
            rate = (BOILING_DEGC - AMBIENT_DEGC) / p.heat_up_s if heats else 0.0
        elif temperature > STEAM_DEGC:
            rate = -(BOILING_DEGC - STEAM_DEGC) / p.steam_after_s
        else:
            rate = -(STEAM_DEGC - SOLID_DEGC) / p.solid_after_s if temperature > AMBIENT_DEGC \
                else 0.0
        return {"tank1.temperature": Linear(rate)} if rate else {}

    def _pressure(self, x: Mapping[str, Any]) -> dict[str, Law]:
        rate = (BURST_BAR - NORMAL_BAR) / self.parameters.burst_s
        if x["explosion"]:
            return {}
        if x["Malf"]:
            return {"condenser.pressure": Linear(rate)} if x["steam"] else {}
        return {"condenser.pressure": Linear(-rate)} if x["condenser.pressure"] > NORMAL_BAR else {}

    # What ends a mode

    def _ends(self, x: Mapping[str, Any]) -> Iterator[Guard]:
        for n in (1, 2):
            level = f"tank{n}.level"
            yield falls(f"{level} empty", level, 0.0, {level: 0.0})
            yield rises(f"{level} brim", level, self._brim(n), {level: self._brim(n)})
        heat, pressure = "tank1.temperature", "condenser.pressure"
        for degree in (STEAM_DEGC, SOLID_DEGC, AMBIENT_DEGC):
            yield falls(f"below {degree}", heat, degree, {heat: degree})
        yield rises("boils", heat, BOILING_DEGC, {heat: BOILING_DEGC})
        yield rises("steam", heat, math.nextafter(STEAM_DEGC, BOILING_DEGC))
        yield rises("bursts", pressure, BURST_BAR, {pressure: BURST_BAR})
        yield falls("relieved", pressure, NORMAL_BAR, {pressure: NORMAL_BAR})


def _both(given: float, taken: float) -> Any:
    """Tank 2 while tank 1 drains into it and it drains itself: no closed form serves."""
    def rate(state: Mapping[str, Any]) -> float:
        return given * math.sqrt(max(state["tank1.level"], 0.0)) \
            - taken * math.sqrt(max(state["tank2.level"], 0.0))
    return rate
