"""Ways to drive a batch plant in tests: single processes, and whole schedules of the paper."""

from __future__ import annotations

from itertools import groupby

from paper_oracle import SECONDS, simulate

from plant_sim.batch_plant import BatchPlant
from plant_sim.batch_plant.layout import TRANSFERS

S = 1_000_000_000

PATHS = {transfer.name: transfer.actuators for transfer in TRANSFERS}
ACTUATORS_OF = {1: ("V8",), 2: ("V9",), 3: ("V8", "Mixer"), 4: ("V9", "Mixer"), 5: ("V11",)}
ACTUATORS_OF |= {6: ("V12",), 7: ("Heater",), 8: ("V15",), 9: ("V17",), 10: ("V29",)}
ACTUATORS_OF |= {11: PATHS["B7-B1"], 12: PATHS["B6-B2"]}


def plant_with(tanks: str, **parameters: object) -> BatchPlant:
    """A plant with these contents."""
    return BatchPlant({"tanks": tanks, **parameters})


def switch(plant: BatchPlant, *names: str, on: bool = True) -> None:
    """Set these actuators together."""
    plant.actuate(dict.fromkeys(names, on))


def volumes(plant: BatchPlant) -> list[int]:
    """Volume quanta in the tanks and on the floor."""
    return [plant.volume(tank) for tank in [*plant.units.brims, "spill"]]


def commands(load: float, half: str, batches: int) -> list[tuple[int, dict[str, bool]]]:
    """When the paper's controller sets which actuators, as (ns, values), one entry an instant."""
    initial = BatchPlant({"load": load, "half": half}).initial_tanks()
    starts = simulate(initial, batches).starts
    changes = [(t, True, a) for t, p in starts for a in ACTUATORS_OF[p]]
    changes += [(t + SECONDS[p], False, a) for t, p in starts for a in ACTUATORS_OF[p]]
    changes.sort()
    return [
        (t_s * S, {name: value for _, value, name in group})
        for t_s, group in groupby(changes, key=lambda change: change[0])
    ]


def replay(plant: BatchPlant, load: float, half: str, batches: int) -> None:
    """Give a plant the commands of the paper's controller up to the start of the last batch."""
    end_ns = S * simulate(plant.initial_tanks(), batches).batches_s[-1]
    for t_ns, values in commands(load, half, batches):
        if t_ns <= end_ns:
            plant.advance(t_ns)
            plant.actuate(values)
