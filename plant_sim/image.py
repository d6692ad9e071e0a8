"""A plant's whole state as bytes: equal states are equal bytes."""

from __future__ import annotations

import json

from plant_sim.contract import Plant


def save(plant: Plant) -> bytes:
    """The complete state of a plant."""
    return json.dumps(plant.snapshot(), sort_keys=True, separators=(",", ":")).encode()


def restore(plant: Plant, image: bytes) -> None:
    """Let a plant of the same kind and parameters go on from a saved state, bit-identically.

    Raises ValueError for bytes that are no such state.
    """
    try:
        plant.restore(json.loads(image))
    except (KeyError, TypeError, UnicodeDecodeError) as error:
        raise ValueError(f"the bytes are no state of a {plant.name}: {error!r}") from error
