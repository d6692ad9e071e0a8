"""Plants by name: the table of those that come with the package, and the way to a user's own."""

from __future__ import annotations

import difflib
import hashlib
import importlib
import sys
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType
from typing import cast

from plant_sim.contract import Plant

PLANTS: dict[str, str] = {
    "batch_plant": "plant_sim.batch_plant:BatchPlant",
    "conveyor": "plant_sim.conveyor:Conveyor",
    "evaporator": "plant_sim.evaporator:Evaporator",
    "heating_tank": "plant_sim.heating_tank:HeatingTank",
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
    """The class registered as `name`, or the one at "package.module:Class" or "path/file.py:Class".

    The class may be left out where the file defines one plant only. Raises PlantLoadError.
    """
    path = PLANTS.get(name, name)
    module_name, _, class_name = path.rpartition(":") if ":" in path else (path, "", "")
    if module_name.endswith(".py"):
        module = _module_of_file(name, Path(module_name))
        class_name = class_name or _only_plant(name, module)
    elif module_name and class_name:
        module = _module(name, module_name)
    else:
        raise PlantLoadError(name, _unknown(name))
    found = getattr(module, class_name, None)
    if not isinstance(found, type):
        raise PlantLoadError(name, f"{module_name} has no class {class_name}")
    return cast(PlantClass, found)


def _module(name: str, module_name: str) -> ModuleType:
    try:
        return importlib.import_module(module_name)
    except ImportError as error:
        raise PlantLoadError(name, f"cannot import {module_name}: {error}") from error


def _module_of_file(name: str, path: Path) -> ModuleType:
    """Run a file as a module of its own; it may import what stands beside it."""
    try:
        text = path.read_bytes()
    except OSError as error:
        raise PlantLoadError(name, f"{path} cannot be read: {error.strerror}") from None
    module_name = f"plant_{path.stem}_{hashlib.sha256(text).hexdigest()[:12]}"
    if module_name in sys.modules:
        return sys.modules[module_name]
    module = ModuleType(module_name)
    module.__file__ = str(path)
    sys.modules[module_name] = module
    sys.path.insert(0, str(path.parent.resolve()))
    try:
        exec(compile(text, str(path), "exec"), module.__dict__)
    except Exception as error:
        del sys.modules[module_name]
        raise PlantLoadError(name, f"{path} cannot be run: {_told(error, path)}") from error
    finally:
        sys.path.pop(0)
    return module


def _told(error: Exception, path: Path) -> str:
    """An error of a user's file with the line of the file that it came from."""
    if isinstance(error, SyntaxError):
        return f"line {error.lineno}: {error.msg}"
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__)
             if frame.filename == str(path)]
    at = f"line {lines[-1]}: " if lines else ""
    return f"{at}{type(error).__name__}: {error}"


def _only_plant(name: str, module: ModuleType) -> str:
    own = [key for key, value in vars(module).items()
           if isinstance(value, type) and value.__module__ == module.__name__
           and hasattr(value, "next_event_ns")]
    if len(own) != 1:
        found = ", ".join(own) or "none"
        raise PlantLoadError(name, f"expected one plant class, found {found}; "
                             f"name it: {name}:CLASS")
    return own[0]


def load(name: str, parameters: Mapping[str, object] | None = None) -> Plant:
    """A new plant. Raises PlantLoadError, or ParameterError for a bad parameter."""
    plant = find(name)(dict(parameters or {}))
    if not isinstance(plant, Plant):
        raise PlantLoadError(name, "the class does not keep the plant contract")
    return plant


def _unknown(name: str) -> str:
    near = difflib.get_close_matches(name, PLANTS, n=1)
    hint = f"did you mean {near[0]}? " if near else ""
    return f"unknown; {hint}known: {', '.join(sorted(PLANTS))}, or package.module:Class, or file.py"
