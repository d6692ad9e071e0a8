"""The quanta in which a batch plant counts: chosen so that every flow is whole quanta per ns.

So volumes are exact integers for ever. Salt and heat are counted in thousandths of (g/l) and of K
per quantum of volume: exact for 0, 3 and 5 g/l and for whole degrees, within one quantum (some
1e-18 g) for other mixtures.
"""

from __future__ import annotations

import math
from fractions import Fraction

from plant_sim.batch_plant.layout import (
    BOILING_DEGC,
    COLD_DEGC,
    TANKS,
    TRANSFERS,
    WATER_L,
)
from plant_sim.batch_plant.parameters import BatchParameters
from plant_sim.lines import exact, seconds_to_ns

FINE = 1000
"""Salt quanta of one volume quantum at 1 g/l; heat quanta of one volume quantum at 1 K."""

STEAM_HEAT = (BOILING_DEGC - COLD_DEGC) * FINE
"""Heat quanta above cold of one volume quantum at the boiling point."""

WET_L = Fraction(1, 100)
"""Liquid that must gather in an emptied tank before it gives any again, l."""


class Units:
    """Quantum sizes and, in quanta, the capacities and rates for one set of parameters."""

    def __init__(self, parameters: BatchParameters) -> None:
        flows_l_per_ns = {
            transfer.name: transfer.unit_l / seconds_to_ns(getattr(parameters, transfer.duration))
            for transfer in TRANSFERS
        }
        boiling_ns = seconds_to_ns(parameters.heat_B5_s) - seconds_to_ns(parameters.heat_up_s)
        flows_l_per_ns["steam"] = WATER_L / boiling_ns
        brims_l = {tank.name: tank.capacity_l + exact(parameters.brim_l) for tank in TANKS}
        level = exact(parameters.level_resolution_l)
        parts = [*flows_l_per_ns.values(), *brims_l.values(), level, WET_L]
        self.per_litre = math.lcm(*(part.denominator for part in parts))
        """Volume quanta in one litre."""
        self.rates = {name: self.of_litres(flow) for name, flow in flows_l_per_ns.items()}
        """Volume quanta per ns of every transfer, and of the steam."""
        self.brims_l = brims_l
        self.brims = {name: self.of_litres(brim) for name, brim in brims_l.items()}
        """Volume quanta at which a tank overflows."""
        self.wet = self.of_litres(WET_L)
        """Volume quanta from which on a tank that fills gives liquid again."""

    def of_litres(self, volume_l: Fraction) -> int:
        """A volume in quanta; exact for all volumes in hundredths of litres."""
        return int(volume_l * self.per_litre)

    def litres(self, quanta: int) -> float:
        """Volume quanta as l."""
        return quanta / self.per_litre

    def grams(self, quanta: int) -> float:
        """Salt quanta as g."""
        return quanta / (self.per_litre * FINE)

    @staticmethod
    def concentration_g_l(salt: int, volume: int) -> Fraction:
        """Concentration of salt quanta in volume quanta; 0 for an empty tank."""
        return Fraction(salt, volume * FINE) if volume > 0 else Fraction(0)

    @staticmethod
    def temperature_degC(heat: int, volume: int) -> Fraction:
        """Temperature of heat quanta in volume quanta; cold for an empty tank."""
        warmth = Fraction(heat, volume * FINE) if volume > 0 else Fraction(0)
        return COLD_DEGC + warmth
