"""YAML with places: the values of a file, and the line of every key path in it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from plcemu.base.errors import ConfigError

KeyPath = tuple[str | int, ...]

SIZE_LIMIT = 1_000_000
"""The largest configuration file read, in bytes."""


def read_yaml(path: Path) -> tuple[dict[str, Any], dict[KeyPath, int]]:
    """Return a file's mapping, and the line (from 1) on which each key path stands.

    Raises:
        ConfigError: the file cannot be read, is no YAML, or is no mapping.
    """
    try:
        if path.stat().st_size > SIZE_LIMIT:
            raise ConfigError([f"{path}: larger than {SIZE_LIMIT} bytes, the limit"])
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise ConfigError([f"{path}: is not UTF-8 text"]) from None
    except OSError as problem:
        raise ConfigError([f"{path}: cannot be read: {problem.strerror}"]) from None
    try:
        node = yaml.compose(text, Loader=yaml.SafeLoader)
        value = yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, RecursionError) as problem:
        raise ConfigError([_yaml_problem(path, problem)]) from None
    if value is None:
        raise ConfigError([f"{path}: is empty; write at least 'program: FILE'"])
    if not isinstance(value, dict):
        raise ConfigError([f"{path}:1: found {type(value).__name__}, expected keys and values"])
    lines: dict[KeyPath, int] = {}
    _collect(node, (), lines)
    return value, lines


def _yaml_problem(path: Path, problem: Exception) -> str:
    mark = getattr(problem, "problem_mark", None)
    what = getattr(problem, "problem", None) or str(problem).splitlines()[0]
    return f"{path}:{mark.line + 1}: {what}" if mark is not None else f"{path}: {what}"


def _collect(node: yaml.Node | None, path: KeyPath, lines: dict[KeyPath, int]) -> None:
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            inner = (*path, str(key.value))
            lines[inner] = key.start_mark.line + 1
            _collect(value, inner, lines)
    elif isinstance(node, yaml.SequenceNode):
        for n, value in enumerate(node.value):
            lines[(*path, n)] = value.start_mark.line + 1
            _collect(value, (*path, n), lines)
