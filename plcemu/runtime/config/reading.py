"""Reading a configuration: its file, the one it extends, and the overrides of a command line.

Paths in a file are relative to that file. `extends` takes another configuration as the base.
"""

from __future__ import annotations

import copy
import reprlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from pydantic import ValidationError

from plcemu.base.errors import ConfigError
from plcemu.runtime.config.mistakes import problem_text, shown
from plcemu.runtime.config.overrides import override
from plcemu.runtime.config.sections import Config, RecordSection, known_keys
from plcemu.runtime.yamltext import KeyPath, read_yaml

FILE_NAME = "config.yaml"
_EXTENDS_LIMIT = 8


def find_config(path: str | Path | None) -> Path:
    """Return the configuration file: the file itself, the one in a folder, or ./config.yaml.

    Raises:
        ConfigError: there is none.
    """
    chosen = Path(path) if path is not None else Path(FILE_NAME)
    try:
        if chosen.is_dir():
            chosen = chosen / FILE_NAME
        found = chosen.is_file()
    except (OSError, ValueError) as problem:
        why = getattr(problem, "strerror", None) or problem
        raise ConfigError([f"{reprlib.repr(str(chosen))}: cannot be read: {why}"]) from None
    if not found:
        raise ConfigError([(f"{chosen}: there is no such file; name a configuration file, or a "
                            f"folder that holds {FILE_NAME}")])
    return chosen


@dataclass(frozen=True)
class ConfigText:
    """A configuration as read, of which overrides make one configuration after another."""

    file: Path
    values: Mapping[str, Any]
    places: Mapping[KeyPath, str]

    @classmethod
    def read(cls, path: str | Path | None) -> Self:
        """Read a configuration file, or the one in a folder.

        Raises:
            ConfigError: it cannot be read.
        """
        file = find_config(path)
        return cls(file, *_read(file, ()))

    def config(self, overrides: Sequence[str] = ()) -> Config:
        """Return the configuration with `NAME=VALUE` overrides.

        Raises:
            ConfigError: with every mistake, each with its file and line.
        """
        values, places = copy.deepcopy(dict(self.values)), dict(self.places)
        for text in overrides:
            key = override(values, text)
            places[key] = f"--set {text}"
            if key in _PATH_KEYS:
                _find_beside(values, key, self.file.parent)
        try:
            config = Config.model_validate(values)
        except ValidationError as problems:
            raise ConfigError([problem_text(str(self.file), places, p, known_keys)
                               for p in problems.errors()]) from None
        config._file, config._places = str(self.file), places
        return config


def load_config(path: str | Path | None, overrides: Sequence[str] = ()) -> Config:
    """Read a configuration and the `NAME=VALUE` overrides for it.

    NAME is a key path such as `plant.time_scale`, or just the last part of one (`cycle`, `load`,
    `port`): a parameter of the plant comes first.

    Raises:
        ConfigError: with every mistake, each with its file and line.
    """
    return ConfigText.read(path).config(overrides)


_PATH_KEYS: tuple[KeyPath, ...] = (("program",), ("properties",), ("verify", "properties"))
_FILE_KEYS = (("retain", "file"), ("control", "socket"), ("historian", "file"))


def _find_beside(values: dict[str, Any], key: KeyPath, folder: Path) -> None:
    """Let files of the command line that do not exist as named stand beside the configuration."""
    section = values if len(key) == 1 else values[key[0]]
    section[key[-1]] = [str(folder / p) if isinstance(p, str) and not Path(p).exists()
                        and (folder / p).exists() else p for p in _as_list(section[key[-1]])]


def _read(file: Path, extended: tuple[Path, ...]) -> tuple[dict[str, Any], dict[KeyPath, str]]:
    """Read a file over the one it extends; return values and the place of every key path."""
    values, lines = read_yaml(file)
    places = {key: f"{file}:{line}" for key, line in lines.items()}
    for *above, key in _PATH_KEYS:
        section = values.get(above[0]) if above else values
        if isinstance(section, dict) and isinstance(section.get(key), str | list):
            section[key] = [str(file.parent / p) if isinstance(p, str) else p
                            for p in _as_list(section[key])]
    for name, key in _FILE_KEYS:
        section = values.get(name)
        if isinstance(section, dict) and isinstance(section.get(key), str):
            section[key] = str(file.parent / section[key])
    _place_plant(values.get("plant"), file.parent)
    _place_recordings(values.get("reactions"), file.parent)
    if "extends" not in values:
        return values, places
    base, where = values.pop("extends"), places.pop(("extends",))
    if not isinstance(base, str):
        raise ConfigError([f"{where}: extends: found {shown(base)}, expected a file or folder"])
    extended = (*extended, file.resolve())
    try:
        base_file = find_config(file.parent / base)
    except ConfigError as problem:
        raise ConfigError([f"{where}: extends: {problem}"]) from None
    if base_file.resolve() in extended:
        raise ConfigError([f"{where}: extends: {base_file} extends this file, in a circle"])
    if len(extended) > _EXTENDS_LIMIT:
        raise ConfigError([f"{where}: extends goes deeper than {_EXTENDS_LIMIT} files"])
    base_values, base_places = _read(base_file, extended)
    return _merged(base_values, values), {**base_places, **places}


def _place_plant(plant: Any, folder: Path) -> None:
    """Let the files of a plant's section be relative to the configuration's folder."""
    if not isinstance(plant, dict):
        return
    model, scenario = plant.get("model"), plant.get("scenario")
    if isinstance(model, str) and (model.endswith(".py") or ".py:" in model):
        plant["model"] = str(folder / model)
    if isinstance(scenario, str):
        plant["scenario"] = str(folder / scenario)


def _place_recordings(reactions: Any, folder: Path) -> None:
    """Let the files of recordings be relative to the configuration's folder."""
    for reaction in reactions.values() if isinstance(reactions, dict) else ():
        record = reaction.get("record") if isinstance(reaction, dict) else None
        if isinstance(record, dict):
            name = record.get("file", RecordSection().file)
            record["file"] = str(folder / name) if isinstance(name, str) else name


def _as_list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [value]


def _merged(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    result = dict(base)
    for key, value in over.items():
        both = isinstance(value, dict) and isinstance(base.get(key), dict)
        result[key] = _merged(base[key], value) if both else value
    return result
