"""Mistakes in a file of keys and values: each on one line with its place, found and expected."""

from __future__ import annotations

import reprlib
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from plcemu.base.errors import did_you_mean
from plcemu.runtime.yamltext import KeyPath


def problem_text(file: str, places: Mapping[KeyPath, str], error: Any,
                 known: Callable[[KeyPath], Iterable[str]]) -> str:
    """Return one line on a mistake that pydantic found: place, key, found, expected.

    Args:
        file: that was read.
        places: of its keys.
        error: as pydantic describes it.
        known: the keys that may stand where one of this path stands.
    """
    location: KeyPath = tuple(str(p) for p in error["loc"] if p != "[key]")
    where, path = place_of(file, places, location), ".".join(location)
    if error["type"] == "invalid_key":
        return f"{where}: the key {path} must be a text"
    if error["type"] == "missing":
        return f"{where}: {path} is missing"
    if error["type"] == "extra_forbidden":
        keys = known(location)
        return f"{where}: there is no key {path!r}{did_you_mean(location[-1], keys)}"
    return f"{where}: {path}: found {shown(error['input'])}, expected {_expected(error)}"


def place_of(file: str, places: Mapping[KeyPath, str], path: KeyPath) -> str:
    """Return where a key stands, or the nearest key above it that stands anywhere."""
    above = (path[:n] for n in range(len(path), 0, -1))
    return next((places[p] for p in above if p in places), file)


def shown(value: object) -> str:
    """Return a value as text of bounded length, keys and values told but not written out."""
    if isinstance(value, dict):
        return "keys and values"
    return "a list" if isinstance(value, list) else reprlib.repr(value)


def _expected(error: Any) -> str:
    message = str(error["msg"])
    for said in ("Value error, ", "Input should be ", "a valid "):
        message = message.removeprefix(said)
    if error["type"] == "list_type":
        return "a list"
    if error["type"] in ("model_type", "dict_type", "model_attributes_type"):
        return "keys and values"
    return message[0].lower() + message[1:]
