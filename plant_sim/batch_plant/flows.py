"""Which flows run and which mode each tank is in, from the actuators and the volumes alone."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import NamedTuple

from plant_sim.batch_plant.layout import (
    CONDENSATE,
    COOLERS,
    HEATED,
    LEAKS,
    NO_COOLANT,
    NO_HEAT,
    PUMPS,
    TRANSFERS,
    WEARS,
    Transfer,
)
from plant_sim.batch_plant.tanks import BatchTanks
from plant_sim.batch_plant.units import FINE, STEAM_HEAT
from plant_sim.contract import PortValue
from plant_sim.curves import NS_PER_S
from plant_sim.lines import exact
from plant_sim.memory import Memory

SALT, HEAT = "salt", "heat"
SPILL = "spill"
"""The floor: a tank that only takes."""
STILL = Fraction(0)

_NEARLY_BOILING = STEAM_HEAT - FINE // 100
"""From 99.99 degC on the heater makes steam; so a tank cooled by a trace need not heat up anew."""


STEAM, LEAK = "steam", "leak"


class Flow(NamedTuple):
    """Liquid or steam that moves now, `rate` volume quanta per ns; a leak goes to the floor."""

    name: str
    source: str
    sink: str
    rate: int
    transfer: Transfer | None

    def of(self, stuff: str, memory: Memory) -> Fraction:
        """Quanta per ns of salt or heat that go with it, at the strength fixed on entry."""
        if self.name == STEAM:
            return Fraction(self.rate * STEAM_HEAT) if stuff == HEAT else STILL
        return self.rate * memory.rates[f"{self.source}.{stuff}"]


class TankMode(NamedTuple):
    """What happens to one tank: flows, spilled quanta per ns, net quanta per ns, heater or cooler.

    `thermal` is "", "heating", "boiling" or "cooling"; two equal `word`s are the same mode.
    """

    inflows: tuple[Flow, ...]
    outflows: tuple[Flow, ...]
    spilled: int
    net: int
    thermal: str

    @property
    def word(self) -> str:
        """The mode as text."""
        if self.at_rest:
            return ""
        parts = [flow.name for flow in self.inflows + self.outflows]
        return " ".join([*parts, self.thermal, "full" if self.spilled else ""]).strip()

    @property
    def at_rest(self) -> bool:
        """Whether nothing happens to the tank."""
        return not (self.inflows or self.outflows or self.thermal)

    @property
    def compound(self) -> bool:
        """Whether straight lines only approximate this mode."""
        drains = any(flow.name != STEAM for flow in self.outflows)
        boils = self.thermal == "boiling"
        if drains and (self.inflows or boils):
            return True
        return bool(self.thermal) and (drains or bool(self.inflows))


def choose_modes(plant: BatchTanks) -> dict[str, TankMode]:
    """The mode of every tank at the present instant; notes which tanks are `low`."""
    volumes = {tank: plant.volume(tank) for tank in plant.units.brims}
    givers, flows, thermal = _givers(plant, volumes)
    into: dict[str, list[Flow]] = {tank: [] for tank in volumes}
    out_of: dict[str, list[Flow]] = {tank: [] for tank in volumes}
    for flow in flows:
        out_of[flow.source].append(flow)
        if flow.sink in into:
            into[flow.sink].append(flow)
    modes = {}
    for tank, volume in volumes.items():
        plant.memory.flags[f"{tank} low"] = tank not in givers
        inflows, outflows = tuple(into[tank]), tuple(out_of[tank])
        net = sum([flow.rate for flow in inflows]) - sum([flow.rate for flow in outflows])
        spilled = net if net > 0 and volume >= plant.units.brims[tank] else 0
        modes[tank] = TankMode(inflows, outflows, spilled, net - spilled, thermal.get(tank, ""))
    return modes


def _givers(
    plant: BatchTanks, volumes: Mapping[str, int]
) -> tuple[set[str], list[Flow], dict[str, str]]:
    """The tanks that can give liquid, and the flows and heating that follow.

    A tank that was empty and fills is low, and gives nothing, until it is wet or until
    nothing more comes in; or it would start and stop every few ns where its outlet is faster.
    """
    wet = plant.units.wet
    flags = plant.memory.flags
    givers = {t for t, v in volumes.items() if v >= wet or (v > 0 and not flags[f"{t} low"])}
    while True:
        thermal = _thermal(plant, volumes, givers)
        flows = _flows(plant, givers, thermal)
        filling = {flow.sink for flow in flows}
        freed = {t for t, v in volumes.items() if v > 0} - givers - filling
        if not freed:
            return givers, flows, thermal
        givers |= freed


def _flows(plant: BatchTanks, givers: set[str], thermal: Mapping[str, str]) -> list[Flow]:
    on, rates = plant.actuators, plant.units.rates
    open_now = {name for name, value in on.items() if value}
    flows = [
        Flow(transfer.name, transfer.source, transfer.sink, rates[transfer.name], transfer)
        for transfer in TRANSFERS
        if transfer.source in givers and open_now.issuperset(transfer.actuators)
    ]
    if not open_now.isdisjoint(WEARS):
        flows = [_worn(flow, on) for flow in flows]
    if thermal.get(HEATED) == "boiling":
        flows.append(Flow(STEAM, HEATED, CONDENSATE, rates[STEAM], None))
    for tank, port in LEAKS.items():
        if port in open_now and tank in givers:
            rate = plant.units.of_litres(exact(on[port]) / NS_PER_S)
            flows.append(Flow(f"{tank} {LEAK}", tank, SPILL, rate, None))
    return flows


def _worn(flow: Flow, on: Mapping[str, PortValue]) -> Flow:
    """A flow through a pump that gives less than it should; one that gives nothing stands."""
    assert flow.transfer is not None
    lost = sum(exact(on[f"{name}.worn"]) for name in flow.transfer.actuators if name in PUMPS)
    return flow._replace(rate=int(flow.rate * (1 - lost)))


def _thermal(plant: BatchTanks, volumes: Mapping[str, int], givers: set[str]) -> dict[str, str]:
    thermal = {
        cooler.tank: "cooling"
        for cooler in COOLERS
        if plant.actuators[cooler.valve]
        and not plant.actuators[NO_COOLANT]
        and cooler.tank in givers
        and plant.heat(cooler.tank) > 0
    }
    if plant.actuators["Heater"] and not plant.actuators[NO_HEAT] and HEATED in givers:
        boils = plant.heat(HEATED) >= volumes[HEATED] * _NEARLY_BOILING
        thermal[HEATED] = "boiling" if boils else "heating"
    return thermal
