"""The conveyor: driven to a test position, which a limit switch shows, and back.

B. Denis, J.-J. Lesage, Z. Juárez-Orozco: Performance verification of discrete event systems using
hybrid model-checking (ADHS 2006). The speed is an unknown constant of a run; the way back takes an
unknown time. Both are drawn by the seed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from plant_sim.automaton import HybridAutomaton, Linear, Mode, actuator, falls, rises, switch
from plant_sim.chance import uniform
from plant_sim.contract import Fact, Port
from plant_sim.conveyor.exact import automaton
from plant_sim.gauges import Sensor
from plant_sim.linear_automaton import Automaton
from plant_sim.lines import exact
from plant_sim.parameters import Parameters, parameter


@dataclass(frozen=True)
class ConveyorParameters(Parameters):
    """The axis (section 3.3 of the paper) and its perturbations."""

    speed_mm_s: float = parameter(200.0, "speed without perturbation", unit="mm/s",
                                  low=0.001, high=1e5)
    perturbation_pct: float = parameter(0.0, "largest deviation of the speed, to either side",
                                        unit="%", low=0.0, high=99.0)
    test_mm: float = parameter(80.0, "position of the limit switch at the test station",
                               unit="mm", low=0.001, high=1e5)
    end_mm: float = parameter(150.0, "end of the axis", unit="mm", low=0.001, high=1e6)
    test_ms: float = parameter(500.0, "time that the test of a gear takes at the test station",
                               unit="ms", low=0.0, high=1e7)
    return_min_ms: float = parameter(3000.0, "shortest time of the way back", unit="ms",
                                     low=0.001, high=1e7)
    return_max_ms: float = parameter(3500.0, "longest time of the way back", unit="ms",
                                     low=0.001, high=1e7)
    seed: int = parameter(0, "of the speed and of the times of the way back", low=0, high=2**63)


class Conveyor(HybridAutomaton):
    """An axis with a motor of two directions and a switch at either station."""

    name = "conveyor"
    parameter_type = ConveyorParameters
    parameters: ConveyorParameters

    def elements(self) -> Iterable[Port | Sensor | Fact]:
        """Switches, motor, and what an observer measures."""
        p = self.parameters
        return (
            switch("load_pos", "at the loading station", of="position", at_most=0.0),
            switch("test_pos", "at the test station or beyond", of="position",
                   at_least=p.test_mm),
            switch("test_done", "the gear at the test station has been tested", of="tested",
                   at_least=1.0),
            actuator("go_to_test", "motor clockwise"),
            actuator("go_back", "motor counterclockwise"),
            Fact("stop_mm", "real", "mm", "where the conveyor last stood still after a way out"),
            Fact("stops", "int", "", "how often it has stood still after a way out"),
            Fact("speed_mm_s", "real", "mm/s", "its speed in this run, with the perturbation"),
            Fact("collision", "bool", "", "has run against an end, or both directions at once"),
        )

    def begin(self) -> Mapping[str, Any]:
        """At the loading station, at rest."""
        p = self.parameters
        spread = p.perturbation_pct / 100 * (2 * uniform(p.seed, "speed") - 1)
        return {"position": Fraction(0), "speed_mm_s": p.speed_mm_s * (1 + spread),
                "tested": Fraction(0), "going": False, "returns": 0, "way_back_mm": 0.0,
                "stop_mm": 0.0, "stops": 0, "collision": False}

    def mode(self, x: dict[str, Any], on: Mapping[str, Any]) -> Mode:
        """Goes, returns or stands still."""
        p = self.parameters
        if on["go_to_test"] and on["go_back"]:
            return Mode(now={"collision": True, "going": False})
        if on["go_to_test"]:
            if x["position"] >= p.end_mm:
                return Mode(now={"collision": True})
            return Mode({"position": Linear(x["speed_mm_s"])}, now={"going": True}, guards=(
                rises("end", "position", p.end_mm, reset={"position": exact(p.end_mm)}),))
        if x["going"]:
            return Mode(now={"going": False, "stop_mm": x["position"], "stops": x["stops"] + 1,
                             "way_back_mm": x["position"], "tested": Fraction(0)})
        if on["go_back"] and x["position"] > 0:
            if x["tested"]:
                return Mode(now={"tested": Fraction(0)})
            return Mode({"position": Linear(-self._return_mm_s(x))}, guards=(
                falls("loaded", "position", 0, reset={
                    "position": Fraction(0), "returns": x["returns"] + 1}),))
        if x["position"] >= p.test_mm and x["tested"] < 1:
            # The test's progress, from 0 to 1.
            if not p.test_ms:
                return Mode(now={"tested": Fraction(1)})
            return Mode({"tested": Linear(1000 / exact(p.test_ms))}, guards=(
                rises("tested", "tested", 1, reset={"tested": Fraction(1)}),))
        return Mode()

    def _return_mm_s(self, x: Mapping[str, Any]) -> float:
        """The speed at which this way back takes the time that was drawn for it."""
        p = self.parameters
        low, high = sorted((p.return_min_ms, p.return_max_ms))
        took_ms = low + (high - low) * uniform(p.seed, "return", x["returns"])
        return float(x["way_back_mm"]) / took_ms * 1000

    def automaton(self) -> Automaton:
        """All that this conveyor can do, exactly."""
        return automaton(self.parameters)
