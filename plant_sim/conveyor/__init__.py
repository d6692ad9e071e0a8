"""The conveyor of Denis, Lesage and Juárez-Orozco: a displacement axis that a PLC positions."""

from plant_sim.conveyor.plant import Conveyor, ConveyorParameters

__all__ = ["Conveyor", "ConveyorParameters"]
