"""Soft plants for a PLC: processes with sensors and actuators, exact in integer nanoseconds."""

from plant_sim.contract import Fact, FactValue, Plant, Port, PortValue
from plant_sim.parameters import Parameter, ParameterError, Parameters
from plant_sim.registry import PlantLoadError, load

__all__ = [
    "Fact",
    "FactValue",
    "Parameter",
    "ParameterError",
    "Parameters",
    "Plant",
    "PlantLoadError",
    "Port",
    "PortValue",
    "load",
]
