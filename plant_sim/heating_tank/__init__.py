"""The heating tank of Klein, Frey, Lesage and Litz: filled, stirred, heated, emptied."""

from plant_sim.heating_tank.plant import HeatingTank, HeatingTankParameters

__all__ = ["HeatingTank", "HeatingTankParameters"]
