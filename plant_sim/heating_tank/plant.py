"""The heating tank: a stirred tank with an inlet, an outlet, a heater and an operator.

Ports are named as in the paper (Tables 1 and 2). The paper gives no sizes; the defaults are those
of a small laboratory tank.

Energy balance of the stirred contents, with volume V, temperature T, inflow q, heating power P and
loss coefficient U: c (V + heel) T' = c q (T_in - T) + P - U (T - T_room). The outlet obeys
Torricelli's law, V' = -k sqrt(V).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from plant_sim.automaton import (
    Alarm,
    Approach,
    Guard,
    HybridAutomaton,
    Linear,
    Mode,
    Ode,
    Torricelli,
    actuator,
    falls,
    gauge,
    rises,
    switch,
)
from plant_sim.contract import Fact, Port
from plant_sim.curves import Law
from plant_sim.gauges import Sensor
from plant_sim.lines import seconds_to_ns
from plant_sim.parameters import Parameters, parameter

HEAT_CAPACITY_KJ = 4.186
"""Of a litre of water, kJ/(l K)."""

BOILING_DEGC = 100.0

NEVER = 1 << 62
"""An instant that does not come, ns."""


@dataclass(frozen=True)
class HeatingTankParameters(Parameters):
    """Sizes of the tank, and what its operator does."""

    capacity_l: float = parameter(25.0, "volume at which the tank runs over", unit="l",
                                  low=1.0, high=1e5)
    full_l: float = parameter(20.0, "volume at which the upper level sensor (i2) is on", unit="l",
                              low=0.5, high=1e5)
    empty_l: float = parameter(0.5, "volume below which the lower level sensor (i1) is off",
                               unit="l", low=0.0, high=1e5)
    heel_l: float = parameter(1.0, "volume below the outlet, which always stays", unit="l",
                              low=0.01, high=1e4)
    inflow_l_s: float = parameter(1.0, "flow of valve 1", unit="l/s", low=0.001, high=1e3)
    drain_s: float = parameter(20.0, "time in which valve 2 empties a full tank", unit="s",
                               low=0.1, high=1e5)
    power_kW: float = parameter(40.0, "heating power of valve 3", unit="kW", low=0.001, high=1e5)
    unstirred: float = parameter(0.5, "part of the power that reaches contents at rest",
                                 low=0.0, high=1.0)
    loss_W_K: float = parameter(20.0, "heat lost for each degree above the room's", unit="W/K",
                                low=0.01, high=1e5)
    hot_degC: float = parameter(60.0, "temperature at which the sensor (i3) is on", unit="degC",
                                low=0.0, high=99.0)
    inflow_degC: float = parameter(15.0, "temperature of what flows in", unit="degC",
                                   low=0.0, high=99.0)
    room_degC: float = parameter(20.0, "temperature of the room", unit="degC",
                                 low=-20.0, high=60.0)
    press_s: float = parameter(0.5, "how long the operator holds a button", unit="s",
                               low=0.001, high=60.0)
    start_at_s: float = parameter(1.0, "first press of the start button (i4); 0: never", unit="s",
                                  low=0.0, high=1e6)
    start_every_s: float = parameter(10.0, "from one press to the next; 0: only once", unit="s",
                                     low=0.0, high=1e6)
    stop_at_s: float = parameter(0.0, "first press of the stop button (i5); 0: never", unit="s",
                                 low=0.0, high=1e6)
    stop_every_s: float = parameter(0.0, "from one press to the next; 0: only once", unit="s",
                                    low=0.0, high=1e6)


class HeatingTank(HybridAutomaton):
    """A stirred tank that an operator starts and stops."""

    name = "heating_tank"
    parameter_type = HeatingTankParameters
    parameters: HeatingTankParameters

    def elements(self) -> Iterable[Port | Sensor | Fact]:
        """Sensors, actuators and facts."""
        p = self.parameters
        return (
            switch("i1", "lower level sensor: not empty", of="level", at_least=p.empty_l),
            switch("i2", "upper level sensor: full", of="level", at_least=p.full_l),
            switch("i3", "temperature sensor: hot", of="temperature", at_least=p.hot_degC),
            switch("i4", "start button", of="start"),
            switch("i5", "stop button", of="stop"),
            gauge("level", "contents above the outlet", "l", high=p.capacity_l, resolution=0.1),
            gauge("temperature", "temperature of the contents", "degC", high=200.0,
                  resolution=1.0),
            actuator("o1", "valve 1, filling"),
            actuator("o2", "valve 2, emptying"),
            actuator("o3", "stirring motor"),
            actuator("o4", "valve 3, heating"),
            Fact("batches", "int", "", "full tanks heated and emptied"),
            Fact("overflow", "bool", "", "has run over"),
            Fact("dry_heating", "bool", "", "was heated while the lower level sensor was off"),
            Fact("boiled", "bool", "", "has boiled"),
        )

    def begin(self) -> Mapping[str, Any]:
        """Empty, cold and at rest; the operator's first presses lie ahead."""
        p = self.parameters
        return {"level": 0.0, "temperature": p.room_degC, "heated": False, "batches": 0,
                "overflow": False, "dry_heating": False, "boiled": False,
                "start": False, "start_ns": seconds_to_ns(p.start_at_s) or NEVER,
                "stop": False, "stop_ns": seconds_to_ns(p.stop_at_s) or NEVER}

    def mode(self, x: dict[str, Any], on: Mapping[str, Any]) -> Mode:
        """The flows of the open valves, and what ends them."""
        p = self.parameters
        fills = on["o1"] and x["level"] < p.capacity_l
        drains = on["o2"] and x["level"] > 0
        heats = on["o4"] and x["temperature"] < BOILING_DEGC
        now = {}
        if on["o1"] and not on["o2"] and not fills:
            now["overflow"] = True
        if on["o4"] and x["level"] < p.empty_l:
            now["dry_heating"] = True
        if on["o4"] and not heats:
            now["boiled"] = True
        if x["temperature"] >= p.hot_degC and x["level"] >= p.full_l:
            now["heated"] = True
        power = (p.power_kW * (1.0 if on["o3"] else p.unstirred)) if heats else 0.0
        flows = self._flows(x, p.inflow_l_s if fills else 0.0, drains, power)
        guards = [*self._limits(x), *_button("start", x, p.press_s, p.start_every_s),
                  *_button("stop", x, p.press_s, p.stop_every_s)]
        return Mode(flows, guards, now)

    def _flows(self, x: Mapping[str, Any], inflow: float, drains: bool,
               power: float) -> dict[str, Law]:
        p, flows = self.parameters, dict[str, Law]()
        outflow = 2 * math.sqrt(p.full_l) / p.drain_s
        if inflow and drains:
            flows["level"] = Ode(lambda s: inflow - outflow * math.sqrt(max(s["level"], 0.0)))
        elif inflow:
            flows["level"] = Linear(inflow)
        elif drains:
            flows["level"] = Torricelli(outflow)
        loss_kW = p.loss_W_K / 1000
        if not inflow and not drains:
            capacity = HEAT_CAPACITY_KJ * (x["level"] + p.heel_l)
            flows["temperature"] = Approach(p.room_degC + power / loss_kW, capacity / loss_kW)
        else:
            flows["temperature"] = Ode(lambda s: (
                inflow * (p.inflow_degC - s["temperature"])
                + (power - loss_kW * (s["temperature"] - p.room_degC)) / HEAT_CAPACITY_KJ)
                / (max(s["level"], 0.0) + p.heel_l))
        return flows

    def _limits(self, x: Mapping[str, Any]) -> list[Guard | Alarm]:
        """What ends a flow, and what makes the contents full, hot or gone."""
        p = self.parameters
        delivered = {"heated": False, "batches": x["batches"] + int(x["heated"])}
        return [
            rises("over", "level", p.capacity_l, reset={"level": p.capacity_l}),
            rises("full", "level", p.full_l),
            falls("low", "level", p.empty_l, reset=delivered),
            falls("emptied", "level", 0.0, reset={"level": 0.0}),
            rises("hot", "temperature", p.hot_degC),
            rises("boils", "temperature", BOILING_DEGC),
        ]


def _button(name: str, x: Mapping[str, Any], press_s: float, every_s: float) -> list[Alarm]:
    """Return the instant at which the operator next presses or lets go of a button."""
    t_ns, pressed = x[f"{name}_ns"], x[name]
    if t_ns >= NEVER:
        return []
    press_ns, every_ns = seconds_to_ns(press_s), seconds_to_ns(every_s)
    following = t_ns + press_ns if not pressed else \
        t_ns + max(1, every_ns - press_ns) if every_ns else NEVER
    return [Alarm(name, t_ns, reset={name: not pressed, f"{name}_ns": following})]
