"""The experimental batch plant: brine and water are mixed, evaporated, cooled and used again."""

from plant_sim.batch_plant.parameters import BatchParameters
from plant_sim.batch_plant.plant import BatchPlant

__all__ = ["BatchParameters", "BatchPlant"]
