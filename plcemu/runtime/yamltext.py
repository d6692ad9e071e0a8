"""YAML with places: the values of a file, and the line of every key path in it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from plcemu.base.errors import ConfigError

KeyPath = tuple[str, ...]
"""Keys from the outermost on; a place in a list is its number, from 0, as text."""

SIZE_LIMIT = 1_000_000
"""The largest configuration file read, in bytes."""

VALUES_LIMIT = 100_000
"""Values that a file may hold, aliases written out."""

DEPTH_LIMIT = 30
"""How deep values may stand in each other."""


def read_yaml(path: Path) -> tuple[dict[str, Any], dict[KeyPath, int]]:
    """Return a file's mapping, and the line (from 1) on which each key path stands.

    Raises:
        ConfigError: the file cannot be read, is no YAML, or is no mapping.
    """
    value, lines = read_yaml_value(path)
    if value is None:
        raise ConfigError([f"{path}: is empty; write at least 'program: FILE'"])
    if not isinstance(value, dict):
        raise ConfigError([f"{path}:1: found a {_kind(value)}, expected keys and values"])
    return value, lines


def read_yaml_value(path: Path) -> tuple[Any, dict[KeyPath, int]]:
    """Return a file's value of any kind, and the line (from 1) on which each key path stands.

    Raises:
        ConfigError: the file cannot be read, or is no YAML.
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
        loader = yaml.SafeLoader(text)
        node = loader.get_single_node()
        lines = _Lines(path).of(node) if node is not None else {}
        value = loader.construct_document(node) if node is not None else None
    except (yaml.YAMLError, ValueError, RecursionError) as problem:
        raise ConfigError([_yaml_problem(path, problem)]) from None
    return value, lines


def _kind(value: object) -> str:
    return {list: "list", str: "text", bool: "truth value"}.get(type(value), "number")


def _yaml_problem(path: Path, problem: Exception) -> str:
    if isinstance(problem, RecursionError):
        return f"{path}: values stand in each other deeper than {DEPTH_LIMIT}, the limit"
    mark = getattr(problem, "problem_mark", None)
    what = getattr(problem, "problem", None) or str(problem).splitlines()[0]
    return f"{path}:{mark.line + 1}: {what}" if mark is not None else f"{path}: {what}"


class _Lines:
    """Collects the line of every key path; refuses what is there twice or never ends."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lines: dict[KeyPath, int] = {}

    def of(self, node: yaml.Node) -> dict[KeyPath, int]:
        """Return the lines of everything in a node."""
        self._collect(node, ())
        return self._lines

    def _collect(self, node: yaml.Node, path: KeyPath) -> None:
        line = node.start_mark.line + 1
        if len(self._lines) > VALUES_LIMIT:
            raise ConfigError([f"{self._path}:{line}: more than {VALUES_LIMIT} values, the limit"])
        if len(path) > DEPTH_LIMIT:
            raise ConfigError([(f"{self._path}:{line}: values stand in each other deeper than "
                                f"{DEPTH_LIMIT}, the limit")])
        if isinstance(node, yaml.MappingNode):
            seen: set[str] = set()
            for key, value in node.value:
                at = key.start_mark.line + 1
                if not isinstance(key, yaml.ScalarNode):
                    raise ConfigError([f"{self._path}:{at}: found a key that is no plain text"])
                if key.value in seen:
                    raise ConfigError([f"{self._path}:{at}: the key {key.value!r} is there twice"])
                seen.add(key.value)
                self._enter(key, value, (*path, key.value))
        elif isinstance(node, yaml.SequenceNode):
            for n, value in enumerate(node.value):
                self._enter(value, value, (*path, str(n)))

    def _enter(self, place: yaml.Node, value: yaml.Node, path: KeyPath) -> None:
        self._lines[path] = place.start_mark.line + 1
        self._collect(value, path)
