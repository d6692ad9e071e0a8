"""Plants by name: the table of those that come with the package, and the way to a user's own."""

from __future__ import annotations

import difflib
import importlib
from collections.abc import Callable, Mapping
from typing import cast

from plant_sim.contract import Plant

PLANTS: dict[str, str] = {
    "batch_plant": "plant_sim.batch_plant:BatchPlant",
}
"""Registered name -> "package.module:Class"; imported only when asked for."""

PlantClass = Callable[[Mapping[str, object]], Plant]


class PlantLoadError(ValueError):
    """No plant goes by this name, or what goes by it is no plant."""

    def __init__(self, name: str, reason: str) -> None:
        super().__init__(f"plant {name}: {reason}")
        self.name = name
        self.reason = reason


def find(name: str) -> PlantClass:
    """The class registered as `name`, or the one at a dotted "package.module:Class".

    Raises PlantLoadError.
    """
    path = PLANTS.get(name, name)
    module_name, colon, class_name = path.partition(":")
    if not (colon and module_name and class_name):
        raise PlantLoadError(name, _unknown(name))
    try:
        found = getattr(importlib.import_module(module_name), class_name, None)
    except ImportError as error:
        raise PlantLoadError(name, f"cannot import {module_name}: {error}") from error
    if not isinstance(found, type):
        raise PlantLoadError(name, f"{module_name} has no class {class_name}")
    return cast(PlantClass, found)


def load(name: str, parameters: Mapping[str, object] | None = None) -> Plant:
    """A new plant. Raises PlantLoadError, or ParameterError for a bad parameter."""
    plant = find(name)(dict(parameters or {}))
    if not isinstance(plant, Plant):
        raise PlantLoadError(name, "the class does not keep the plant contract")
    return plant


def _unknown(name: str) -> str:
    near = difflib.get_close_matches(name, PLANTS, n=1)
    hint = f"did you mean {near[0]}? " if near else ""
    return f"unknown; {hint}known: {', '.join(sorted(PLANTS))}, or package.module:Class"
