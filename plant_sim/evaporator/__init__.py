"""The evaporator: two tanks, a heater and a condenser that may fail."""

from plant_sim.evaporator.parameters import EvaporatorParameters
from plant_sim.evaporator.plant import Evaporator

__all__ = ["Evaporator", "EvaporatorParameters"]
