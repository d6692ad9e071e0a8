"""What is in the tanks of a batch plant, in quanta and in units."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import ClassVar

from plant_sim.batch_plant.instruments import FACTS, ports_of, readings_of
from plant_sim.batch_plant.layout import COOLERS
from plant_sim.batch_plant.loads import tanks_of_load
from plant_sim.batch_plant.parameters import BatchParameters
from plant_sim.batch_plant.units import STEAM_HEAT, Units
from plant_sim.hybrid import Guard, HybridPlant
from plant_sim.lines import Form, seconds_to_ns


def ends_of(units: Units) -> dict[str, dict[str, Guard]]:
    """What can end a tank's mode, by tank and event."""
    ends = {}
    for tank, brim in units.brims.items():
        volume, heat = f"{tank}.volume", f"{tank}.heat"
        forms = {
            "empty": Form(((volume, -1),)),
            "full": Form(((volume, 1),), -brim),
            "wet": Form(((volume, 1),), -units.wet),
            "cooled": Form(((heat, -1),)),
            "boiling": Form(((heat, 1), (volume, -STEAM_HEAT))),
        }
        ends[tank] = {event: Guard(f"{tank} {event}", form) for event, form in forms.items()}
    return ends


class BatchTanks(HybridPlant):
    """The seven tanks and what is in them; how it moves is left to `BatchPlant`."""

    name: ClassVar[str] = "batch_plant"
    parameters: BatchParameters

    def __init__(self, parameters: Mapping[str, object] | BatchParameters | None = None) -> None:
        if not isinstance(parameters, BatchParameters):
            parameters = BatchParameters.of(parameters or {})
        self.units = Units(parameters)
        self.ends = ends_of(self.units)
        self._heat_up_ns = seconds_to_ns(parameters.heat_up_s)
        self._cooling_ns = {
            cooler.tank: seconds_to_ns(getattr(parameters, cooler.duration)) for cooler in COOLERS
        }
        self.pump_grace_ns = seconds_to_ns(parameters.pump_grace_s)
        ports = ports_of(parameters, self.units)
        super().__init__(parameters, ports, FACTS, readings_of(parameters, self.units))

    def initial_tanks(self) -> dict[str, str]:
        """Content word of every tank that is not empty at the start."""
        set_up = self.parameters
        return dict(set_up.tanks) or tanks_of_load(set_up.load, set_up.half)

    def volume(self, tank: str) -> int:
        """Liquid in a tank now, in volume quanta (`units.litres` makes it l)."""
        return self._value(f"{tank}.volume")

    def salt(self, tank: str) -> int:
        """Salt in a tank now, in salt quanta (`units.grams` makes it g)."""
        return self._value(f"{tank}.salt")

    def heat(self, tank: str) -> int:
        """Heat above 20 degC in a tank now, in heat quanta."""
        return self._value(f"{tank}.heat")

    def concentration_g_l(self, tank: str) -> Fraction:
        """Exact concentration in a tank now; 0 if it is empty."""
        return self.units.concentration_g_l(self.salt(tank), self.volume(tank))

    def temperature_degC(self, tank: str) -> Fraction:
        """Exact temperature in a tank now; 20 if it is empty."""
        return self.units.temperature_degC(self.heat(tank), self.volume(tank))
