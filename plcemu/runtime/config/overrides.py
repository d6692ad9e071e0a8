"""`--set NAME=VALUE`: a key path, or the last part of one, takes another value."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import yaml

from plant_sim.registry import PLANTS, load
from plcemu.base.errors import ConfigError, did_you_mean
from plcemu.runtime.config.sections import (
    Config,
    ModbusSection,
    PlantSection,
    VerifySection,
    deviation_alone,
    section_at,
)
from plcemu.runtime.yamltext import KeyPath


def override(values: dict[str, Any], text: str) -> KeyPath:
    """Put `NAME=VALUE` into the values of a configuration; return its key path.

    NAME is a key path such as `plant.time_scale`, or just the last part of one.

    Raises:
        ConfigError: there is no such name.
    """
    name, equals, raw = text.partition("=")
    name = name.strip()
    if not equals or not name:
        raise ConfigError([f"--set {text}: expected NAME=VALUE"])
    try:
        value = yaml.safe_load(raw) if raw.strip() else raw
    except (yaml.YAMLError, ValueError, RecursionError):
        value = raw
    path = _resolve(values, name)
    target = values
    for key in path[:-1]:
        inner = target.get(key)
        if _is_point(path, inner):
            inner = {"address": inner}
        elif path[0] == "jitter" and isinstance(inner, str):
            inner = deviation_alone(inner)
        target[key] = {} if inner is None else inner
        target = target[key]
        if not isinstance(target, dict):
            raise ConfigError([f"--set {text}: {key} holds a value, not keys"])
    target[path[-1]] = value
    return tuple(path)


def _is_point(path: Sequence[str], value: object) -> bool:
    """Whether a value is the short form of a point, an address alone."""
    return path[0] == "plant" and path[-1] == "scale" and isinstance(value, str)


_FREE_KEYS = (("safe_outputs",), ("plant", "inputs"), ("plant", "outputs"), ("plant", "devices"))
"""Sections whose keys are the user's names, which may hold dots."""


def _resolve(values: Mapping[str, Any], name: str) -> list[str]:
    """Return the key path that a name stands for."""
    parts = name.split(".")
    if len(parts) == 1 and name not in Config.model_fields:
        return _short_name(values, name)
    if parts[0] not in Config.model_fields:
        raise ConfigError([(f"--set {name}: there is no key {parts[0]!r}"
                            f"{did_you_mean(parts[0], Config.model_fields)}")])
    for free in _FREE_KEYS:
        rest = parts[len(free):]
        if tuple(parts[:len(free)]) == free and rest:
            section = section_at((*free, rest[0]))
            keys = section.model_fields if section else ()
            ending = rest[-1:] if rest[-1] in keys else []
            return [*free, ".".join(rest[:len(rest) - len(ending)]), *ending]
    return parts


def _short_name(values: Mapping[str, Any], name: str) -> list[str]:
    plant = values.get("plant")
    model = plant.get("model") if isinstance(plant, dict) else None
    known = plant_parameters(model) if isinstance(model, str) else []
    if name in known:
        return ["plant", "parameters", name]
    if name in PlantSection.model_fields and isinstance(plant, dict):
        return ["plant", name]
    for key, section in (("modbus", ModbusSection), ("verify", VerifySection)):
        if name in section.model_fields:
            return [key, name]
    options = [*known, *Config.model_fields, *PlantSection.model_fields,
               *ModbusSection.model_fields, *VerifySection.model_fields]
    raise ConfigError([(f"--set {name}: there is no such parameter{did_you_mean(name, options)}; "
                        f"the plant's parameters are {', '.join(known) or 'none'}")])


def plant_parameters(model: str) -> list[str]:
    """Return the names of a plant model's parameters; none for a model that cannot be made."""
    return _parameters_of_own(model) if model in PLANTS else _parameters_of(model)


def _parameters_of(model: str) -> list[str]:
    try:
        return [row.name for row in load(model).parameters.table()]
    except Exception:  # a user's own class may raise anything; making the plant tells what
        return []


_parameters_of_own = cache(_parameters_of)
"""Of the package's own plants, which do not change while it runs."""
