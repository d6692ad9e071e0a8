"""The batch plant as a hybrid plant: which modes there are, and how liquid, salt and heat move.

Every tank has three quantities: volume, salt, and heat above 20 degC. In a mode all are straight
lines; concentration and temperature are their quotients. Modelling choices:

* Mixing is perfect. The strength of what a tank gives away is fixed when the tank's mode begins,
  which is exact as long as it only drains. A tank in a compound mode (it drains while it fills or
  boils, or is heated or cooled while liquid flows) has its strengths and powers fixed anew every
  second.
* Heating up and cooling take the durations of the parameters from whatever temperature they start
  at, since Table 1 of the paper knows one duration: the power is fixed on entry. Nothing loses
  heat by itself; an empty tank counts as cold.
* An emptied tank gives nothing before 0.01 l has gathered in it or nothing more comes in.
* Liquid that enters a tank at its brim runs over and is lost; what is in the tank stays.
* A leak loses its flow, in l/s, for as long as there is liquid, whatever the level.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from fractions import Fraction
from functools import lru_cache
from typing import Any

from plant_sim.batch_plant import summary, supervision
from plant_sim.batch_plant.flows import (
    HEAT,
    LEAK,
    SALT,
    SPILL,
    STILL,
    TankMode,
    choose_modes,
)
from plant_sim.batch_plant.layout import (
    COLD_DEGC,
    CONDENSATE,
    TANKS,
    TRANSFERS,
)
from plant_sim.batch_plant.loads import content_of
from plant_sim.batch_plant.tanks import BatchTanks
from plant_sim.batch_plant.units import FINE, STEAM_HEAT
from plant_sim.contract import FactValue
from plant_sim.hybrid import Guard, Timer
from plant_sim.memory import Memory

REFRESH_NS = 1_000_000_000
"""How often a compound mode fixes its strengths and powers anew, ns."""

_OUTLET = {transfer.source: transfer for transfer in TRANSFERS}
_STUFFS = ("volume", SALT, HEAT)


class BatchPlant(BatchTanks):
    """Seven tanks, their pipes, one heater and two coolers."""

    def _observe(self) -> dict[str, FactValue]:
        """Present values of all facts."""
        return supervision.facts_of(self.memory)

    def report(self) -> dict[str, Any]:
        """Batches, their period, why there are none, final contents, spills and facts."""
        return summary.report_of(self)

    # Hybrid behaviour

    def _begin(self) -> dict[str, int]:
        supervision.begin(self.memory)
        self.memory.numbers["refresh_ns"] = -1
        quantities = dict.fromkeys((f"{SPILL}.{stuff}" for stuff in _STUFFS), 0)
        initial = self.initial_tanks()
        for tank in TANKS:
            content = content_of(initial.get(tank.name, "empty"))
            volume = self.units.of_litres(content.volume_l)
            warmth = content.temperature_degC - COLD_DEGC
            quantities[f"{tank.name}.volume"] = volume
            quantities[f"{tank.name}.salt"] = int(volume * content.concentration_g_l * FINE)
            quantities[f"{tank.name}.heat"] = volume * warmth * FINE
        return quantities

    def _settle(self, fired: frozenset[str]) -> None:
        for event in sorted(fired, key=_empty_first):
            tank, _, what = event.partition(" ")
            _RESETS.get(what, _nothing)(self, tank)
        modes = choose_modes(self)
        self._fix_on_entry(modes, refresh="refresh" in fired)
        for tank, mode in modes.items():
            self._move(tank, mode)
        self._move_spill(modes)
        self._set_refresh(modes)
        supervision.supervise(self, modes)

    def _guards(self) -> Iterable[Guard]:
        for tank, ends in self.ends.items():
            rising = self._rises(f"{tank}.volume")
            if rising < 0:
                yield ends["empty"]
            elif rising > 0:
                yield ends["full"]
                if self.memory.flags[f"{tank} low"]:
                    yield ends["wet"]
            thermal = self.memory.words[f"{tank}.thermal"]
            if thermal == "cooling":
                yield ends["cooled"]
            elif thermal == "heating":
                yield ends["boiling"]

    def _timers(self) -> Iterable[Timer]:
        if self.memory.numbers["refresh_ns"] >= 0:
            yield Timer("refresh", self.memory.numbers["refresh_ns"])
        yield from supervision.pump_timers(self)

    def _fix_on_entry(self, modes: Mapping[str, TankMode], refresh: bool) -> None:
        """Fix strengths and powers of the tanks whose mode begins, or is due for a refresh."""
        words, rates = self.memory.words, self.memory.rates
        for tank, mode in modes.items():
            if words.get(f"{tank}.mode") == mode.word and not (refresh and mode.compound):
                continue
            if mode.thermal == "boiling":
                self._set(f"{tank}.heat", self.volume(tank) * STEAM_HEAT)
            volume, heat = self.volume(tank), self.heat(tank)
            words[f"{tank}.mode"], words[f"{tank}.thermal"] = mode.word, mode.thermal
            rates[f"{tank}.salt"] = Fraction(self.salt(tank), volume) if volume else STILL
            rates[f"{tank}.heat"] = Fraction(heat, volume) if volume else STILL
            rates[f"{tank}.power"] = self._power(tank, mode.thermal, volume, heat)

    def _power(self, tank: str, thermal: str, volume: int, heat: int) -> Fraction:
        if thermal == "heating":
            return Fraction(volume * STEAM_HEAT - heat, self._heat_up_ns)
        return Fraction(-heat, self._cooling_ns[tank]) if thermal == "cooling" else STILL

    def _move(self, tank: str, mode: TankMode) -> None:
        memory = self.memory
        self._slope(f"{tank}.volume", whole(mode.net))
        rests = mode.at_rest
        for stuff in (SALT, HEAT):
            change = STILL
            if not rests:
                change = memory.rates[f"{tank}.power"] if stuff == HEAT else STILL
                for flow in mode.inflows:
                    change = plus(change, flow.of(stuff, memory))
                for flow in mode.outflows:
                    change = plus(change, -flow.of(stuff, memory))
                if mode.spilled:
                    change -= change_lost(mode, stuff, memory)
            self._slope(f"{tank}.{stuff}", change)

    def _move_spill(self, modes: Mapping[str, TankMode]) -> None:
        leaks = [flow for mode in modes.values() for flow in mode.outflows if flow.sink == SPILL]
        full = [mode for mode in modes.values() if mode.spilled]
        spilled = sum(mode.spilled for mode in full) + sum(flow.rate for flow in leaks)
        self._slope(f"{SPILL}.volume", whole(spilled))
        for stuff in (SALT, HEAT):
            lost = sum((change_lost(mode, stuff, self.memory) for mode in full), STILL)
            for flow in leaks:
                lost = plus(lost, flow.of(stuff, self.memory))
            self._slope(f"{SPILL}.{stuff}", lost)

    def _set_refresh(self, modes: Mapping[str, TankMode]) -> None:
        numbers = self.memory.numbers
        if not any(mode.compound for mode in modes.values()):
            numbers["refresh_ns"] = -1
        elif numbers["refresh_ns"] <= self.t_ns:
            numbers["refresh_ns"] = self.t_ns + REFRESH_NS

    def pour(self, source: str, sink: str, parts: Mapping[str, int]) -> None:
        """Move these quanta at once: the part of a ns by which an event came late."""
        for stuff, amount in parts.items():
            self._set(f"{source}.{stuff}", self._value(f"{source}.{stuff}") - amount)
            self._set(f"{sink}.{stuff}", self._value(f"{sink}.{stuff}") + amount)

    def _snap_empty(self, tank: str) -> None:
        """The tank has given all: what it gave too much since the exact instant goes back."""
        outlet = _OUTLET[tank]
        drained = self.memory.flags[f"{outlet.name} flows"]
        leaks = f"{tank} {LEAK}" in self.memory.words[f"{tank}.mode"]
        sink = outlet.sink if drained else SPILL if leaks else CONDENSATE
        if sink != SPILL and self.memory.flags[f"{sink} full"]:
            sink = SPILL
        stuffs = _STUFFS if drained or leaks else ("volume", HEAT)
        self.pour(tank, sink, {stuff: self._value(f"{tank}.{stuff}") for stuff in stuffs})

    def _snap_full(self, tank: str) -> None:
        """The tank is at its brim: what came in since the exact instant has run over."""
        volume = self.volume(tank)
        over = max(volume - self.units.brims[tank], 0)
        salt, heat = self.salt(tank) * over // volume, self.heat(tank) * over // volume
        self.pour(tank, SPILL, {"volume": over, SALT: salt, HEAT: heat})

    def _snap_cooled(self, tank: str) -> None:
        self._set(f"{tank}.heat", 0)

    def _snap_boiling(self, tank: str) -> None:
        self._set(f"{tank}.heat", self.volume(tank) * STEAM_HEAT)


@lru_cache(maxsize=256)
def whole(number: int) -> Fraction:
    """A whole number as a fraction."""
    return Fraction(number)


def plus(one: Fraction, other: Fraction) -> Fraction:
    """The sum; adding nothing, by far the most frequent case, costs nothing."""
    return one + other if one and other else one or other


def change_lost(mode: TankMode, stuff: str, memory: Memory) -> Fraction:
    """Quanta per ns of salt or heat that run over with the liquid that a full tank cannot hold."""
    share = Fraction(mode.spilled, sum(flow.rate for flow in mode.inflows))
    return share * sum((flow.of(stuff, memory) for flow in mode.inflows), STILL)


def _empty_first(event: str) -> str:
    """Sorts events by kind: what an emptied tank gave too much is back before another is full."""
    return event.partition(" ")[2]


def _nothing(plant: BatchPlant, tank: str) -> None:
    """A timer or a guard without a reset."""


_RESETS = {
    "empty": BatchPlant._snap_empty,
    "full": BatchPlant._snap_full,
    "cooled": BatchPlant._snap_cooled,
    "boiling": BatchPlant._snap_boiling,
}
