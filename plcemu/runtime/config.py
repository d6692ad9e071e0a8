"""The configuration: what `config.yaml` may hold, checked once, with the place of every mistake.

Paths in a file are relative to that file. `extends` takes another configuration as the base.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Annotated, Any

import yaml
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, field_validator

from plcemu.base.areas import parse_address
from plcemu.base.errors import ConfigError, did_you_mean
from plcemu.base.time import DurationError, parse_duration_ns
from plcemu.runtime.yamltext import KeyPath, read_yaml

FILE_NAME = "config.yaml"
_EXTENDS_LIMIT = 8


def _duration(value: object) -> int:
    """Read a duration; a bare number has no unit and is refused."""
    if isinstance(value, str):
        try:
            return parse_duration_ns(value)
        except DurationError as problem:
            raise ValueError(str(problem)) from None
    raise ValueError(f"{value!r} is not a duration; write a number and a unit, such as 10ms")


def _positive(value: object) -> int:
    t_ns = _duration(value)
    if t_ns <= 0:
        raise ValueError(f"{value!r} is not positive")
    return t_ns


def _factor(value: object) -> Fraction:
    try:
        factor = Fraction(str(value))
    except (ValueError, ZeroDivisionError):
        raise ValueError(f"{value!r} is not a number") from None
    if factor <= 0:
        raise ValueError(f"{value!r} is not positive")
    return factor


def _texts(value: object) -> object:
    return [value] if isinstance(value, str) else value


Duration = Annotated[int, BeforeValidator(_duration)]
PositiveDuration = Annotated[int, BeforeValidator(_positive)]
Factor = Annotated[Fraction, BeforeValidator(_factor)]
Texts = Annotated[list[str], BeforeValidator(_texts)]


class Section(BaseModel):
    """A part of the configuration; unknown keys are mistakes."""

    model_config = ConfigDict(extra="forbid", frozen=True, arbitrary_types_allowed=True)


class TaskSection(Section):
    """A periodic task: lower priority numbers run first."""

    interval: PositiveDuration
    priority: int = Field(0, ge=0, le=65535)
    phase: Duration = 0
    programs: Texts


class RangeSection(Section):
    """A stretch of the Modbus map."""

    type: str
    first: int = Field(ge=0, le=65535)
    count: int = Field(ge=1, le=65536)
    area: str
    element: int = Field(0, ge=0)
    access: str = "r"
    field_window: bool = False


class ModbusSection(Section):
    """The Modbus TCP server."""

    enabled: bool = True
    host: str = "127.0.0.1"
    port: int = Field(5020, ge=0, le=65535)
    units: list[int] | None = None
    field_window: bool = True
    max_connections: int = Field(64, ge=1, le=10_000)
    idle_timeout: PositiveDuration = 60_000_000_000
    requests_per_scan: int | None = Field(None, ge=1)
    ranges: list[RangeSection] | None = None


class InputSection(Section):
    """Where a sensor's reading goes: an address, and engineering units for one raw count."""

    address: str
    scale: Factor = Fraction(1)


def _input(value: object) -> object:
    return {"address": value} if isinstance(value, str) else value


class PlantSection(Section):
    """The soft plant and its wiring."""

    model: str
    parameters: dict[str, Any] = {}
    time_scale: Factor = Fraction(1)
    inputs: dict[str, Annotated[InputSection, BeforeValidator(_input)]] = {}
    outputs: dict[str, Annotated[InputSection, BeforeValidator(_input)]] = {}
    period: PositiveDuration | None = None

    @field_validator("inputs", "outputs")
    @classmethod
    def _addresses(cls, points: dict[str, InputSection],
                   info: Any) -> dict[str, InputSection]:
        letters = "I" if info.field_name == "inputs" else "Q"
        for name, point in points.items():
            address = parse_address(point.address)
            if address.area[0] != letters:
                raise ValueError(f"{name}: {point.address} is no %{letters} address; sensors go "
                                 "to inputs (%I), actuators follow outputs (%Q)")
        return points


class Config(Section):
    """A whole configuration."""

    name: str = ""
    program: Texts
    cycle: PositiveDuration = 10_000_000
    engine: str = "auto"
    sfc_final_scan: bool = False
    tasks: dict[str, TaskSection] = {}
    safe_outputs: dict[str, bool | int | float] = {}
    speed: Factor = Fraction(1)
    modbus: ModbusSection = ModbusSection()
    plant: PlantSection | None = None
    properties: Texts = []

    @property
    def program_paths(self) -> list[Path]:
        """The program's source files."""
        return [Path(p) for p in self.program]

    @property
    def property_paths(self) -> list[Path]:
        """The files of properties."""
        return [Path(p) for p in self.properties]


def find_config(path: str | Path | None) -> Path:
    """Return the configuration file: the file itself, the one in a folder, or ./config.yaml.

    Raises:
        ConfigError: there is none.
    """
    chosen = Path(path) if path is not None else Path(FILE_NAME)
    if chosen.is_dir():
        chosen = chosen / FILE_NAME
    if not chosen.is_file():
        raise ConfigError([f"{chosen}: there is no such file; name a configuration file, or a "
                           f"folder that holds {FILE_NAME}"])
    return chosen


def load_config(path: str | Path | None, overrides: Sequence[str] = ()) -> Config:
    """Read a configuration and the `NAME=VALUE` overrides for it.

    NAME is a key path such as `plant.time_scale`, or just the last part of one (`cycle`, `load`):
    a parameter of the plant comes first.

    Raises:
        ConfigError: with every mistake, each with its file and line.
    """
    file = find_config(path)
    values, places = _read(file, 0)
    for override in overrides:
        key = _override(values, override)
        places[key] = f"--set {override}"
    try:
        return Config.model_validate(values)
    except ValidationError as problems:
        raise ConfigError([_problem(file, places, p) for p in problems.errors()]) from None


_PATH_KEYS = ("program", "properties")


def _read(file: Path, depth: int) -> tuple[dict[str, Any], dict[KeyPath, str]]:
    """Read a file over the one it extends; return values and the place of every key path."""
    values, lines = read_yaml(file)
    places = {key: f"{file}:{line}" for key, line in lines.items()}
    for key in _PATH_KEYS:
        if isinstance(values.get(key), str | list):
            values[key] = [str(file.parent / str(p)) for p in _as_list(values[key])]
    base = values.pop("extends", None)
    if base is None:
        return values, places
    if depth >= _EXTENDS_LIMIT:
        raise ConfigError([f"{file}: extends goes deeper than {_EXTENDS_LIMIT} files; "
                           "does a file extend itself?"])
    base_values, base_places = _read(find_config(file.parent / str(base)), depth + 1)
    return _merged(base_values, values), {**base_places, **places}


def _as_list(value: object) -> list[object]:
    return value if isinstance(value, list) else [value]


def _merged(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    result = dict(base)
    for key, value in over.items():
        both = isinstance(value, dict) and isinstance(base.get(key), dict)
        result[key] = _merged(base[key], value) if both else value
    return result


# ---------------------------------------------------------------- --set


def _override(values: dict[str, Any], text: str) -> KeyPath:
    name, equals, raw = text.partition("=")
    name = name.strip()
    if not equals or not name:
        raise ConfigError([f"--set {text}: expected NAME=VALUE"])
    try:
        value = yaml.safe_load(raw) if raw.strip() else raw
    except yaml.YAMLError:
        value = raw
    path = _resolve(values, name)
    target = values
    for key in path[:-1]:
        target = target.setdefault(key, {})
        if not isinstance(target, dict):
            raise ConfigError([f"--set {text}: {key} holds a value, not keys"])
    target[path[-1]] = value
    return tuple(path)


def _resolve(values: Mapping[str, Any], name: str) -> list[str]:
    parts = name.split(".")
    if len(parts) == 1 and name not in Config.model_fields:
        plant = values.get("plant")
        known = plant_parameters(plant.get("model", "")) if isinstance(plant, dict) else []
        if name in known:
            return ["plant", "parameters", name]
        if name in PlantSection.model_fields and isinstance(plant, dict):
            return ["plant", name]
        options = [*known, *Config.model_fields, *PlantSection.model_fields]
        raise ConfigError([f"--set {name}: there is no such parameter{did_you_mean(name, options)}; "
                           f"the plant's parameters are {', '.join(known) or 'none'}"])
    if parts[0] not in Config.model_fields:
        raise ConfigError([f"--set {name}: there is no key {parts[0]!r}"
                           f"{did_you_mean(parts[0], Config.model_fields)}"])
    return parts


def plant_parameters(model: str) -> list[str]:
    """Return the names of a plant model's parameters; none for an unknown model."""
    from plant_sim.registry import PlantLoadError, load

    try:
        return [row.name for row in load(model).parameters.table()]
    except (PlantLoadError, ValueError):
        return []


# ---------------------------------------------------------------- mistakes


def _problem(file: Path, places: Mapping[KeyPath, str], error: Any) -> str:
    location: KeyPath = tuple(error["loc"])
    path = ".".join(str(part) for part in location)
    where, prefix = str(file), location
    while prefix:
        if prefix in places:
            where = places[prefix]
            break
        prefix = prefix[:-1]
    if error["type"] == "missing":
        return f"{where}: {path} is missing"
    if error["type"] == "extra_forbidden":
        known = _known_keys(location)
        return f"{where}: there is no key {path!r}{did_you_mean(str(location[-1]), known)}"
    message = str(error["msg"]).removeprefix("Value error, ")
    return f"{where}: {path}: found {error['input']!r}, expected {_expected(message)}" \
        if error["type"] != "value_error" else f"{where}: {path}: {message}"


def _expected(message: str) -> str:
    text = message.removeprefix("Input should be ").removeprefix("a valid ")
    return text[0].lower() + text[1:]


def _known_keys(location: KeyPath) -> list[str]:
    sections = {(): Config, ("plant",): PlantSection, ("modbus",): ModbusSection}
    section = sections.get(location[:-1])
    if section is None and location[0] == "tasks":
        section = TaskSection
    return list(section.model_fields) if section else []
