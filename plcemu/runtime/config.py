"""The configuration: what `config.yaml` may hold, checked once, with the place of every mistake.

Paths in a file are relative to that file. `extends` takes another configuration as the base.
"""

from __future__ import annotations

import copy
import reprlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import yaml
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PrivateAttr,
    ValidationError,
    field_validator,
)

from plant_sim.devices import SAMPLE_NS, Device
from plant_sim.registry import PLANTS, load
from plcemu.base.areas import parse_address
from plcemu.base.errors import ConfigError, did_you_mean
from plcemu.base.time import DurationError, parse_duration_ns
from plcemu.engine.interpreter import BUDGET
from plcemu.runtime.yamltext import KeyPath, read_yaml

FILE_NAME = "config.yaml"
_EXTENDS_LIMIT = 8
_DIGITS_LIMIT = 40
"""Characters of a factor; more, or a huge exponent, is a slip and would take ages to compute."""


def _duration(value: object) -> int:
    """Read a duration; a bare number has no unit and is refused."""
    try:
        if isinstance(value, str):
            return parse_duration_ns(value)
    except (DurationError, ValueError):
        pass
    raise ValueError("a number with a unit of d, h, min, s, ms, us or ns, such as 10ms")


def _not_negative(value: object) -> int:
    t_ns = _duration(value)
    if t_ns < 0:
        raise ValueError("a duration of 0 or more")
    return t_ns


def _positive(value: object) -> int:
    t_ns = _duration(value)
    if t_ns <= 0:
        raise ValueError("a duration of more than 0")
    return t_ns


def _percent(value: object) -> Fraction:
    text, mistake = str(value).strip(), ValueError("a part of the cycle from 0 % to 90 %, "
                                                   "such as 0.5 %")
    if not text.endswith("%") or len(text) > _DIGITS_LIMIT or "e" in text.lower():
        raise mistake
    try:
        part = Fraction(text[:-1].strip()) / 100
    except (ValueError, ZeroDivisionError):
        raise mistake from None
    if not 0 <= part <= Fraction(9, 10):
        raise mistake
    return part


def _factor(value: object) -> Fraction:
    text, mistake = str(value), ValueError("a number between 1e-9 and 1e9")
    exponent = text.lower().partition("e")[2].lstrip("+-")
    if len(text) > _DIGITS_LIMIT or len(exponent) > 2:
        raise mistake
    try:
        factor = Fraction(text)
    except (ValueError, ZeroDivisionError):
        raise mistake from None
    if not Fraction(1, 10**9) <= factor <= 10**9:
        raise mistake
    return factor


def _limit(value: object) -> Fraction | None:
    return None if value is None else _factor(value)


def _number(value: object) -> object:
    if not isinstance(value, bool | int | float):
        raise ValueError("true, false or a number")
    return value


def _texts(value: object) -> object:
    return [value] if isinstance(value, str) else value


def _listed(value: object) -> object:
    """Take a list or a number for the text of what is varied."""
    return ", ".join(map(str, value)) if isinstance(value, list) else _text(value)


def _text(value: object) -> object:
    """Take a number for a text where a text is wanted: a name such as 7 needs no quotes."""
    return str(value) if isinstance(value, int | float) and not isinstance(value, bool) else value


Duration = Annotated[int, BeforeValidator(_not_negative)]
PositiveDuration = Annotated[int, BeforeValidator(_positive)]
Factor = Annotated[Fraction, BeforeValidator(_factor)]
Percent = Annotated[Fraction, BeforeValidator(_percent)]
Texts = Annotated[list[str], BeforeValidator(_texts)]
Number = Annotated[bool | int | float, BeforeValidator(_number)]
Unit = Annotated[int, Field(ge=0, le=255)]
Budget = Annotated[int, Field(ge=1, le=10**15)]


class Section(BaseModel):
    """A part of the configuration; unknown keys are mistakes."""

    model_config = ConfigDict(extra="forbid", frozen=True, arbitrary_types_allowed=True)


class TaskSection(Section):
    """A task: lower priority numbers run first.

    With programs it is a periodic task of its own. Without, it is the task of that name in the
    program text, and what is given here takes the place of what is said there.
    """

    interval: PositiveDuration | None = None
    priority: int | None = Field(None, ge=0, le=65535)
    phase: Duration | None = None
    programs: Texts | None = None
    budget: Budget | None = None
    watchdog: PositiveDuration | None = None


class JitterSection(Section):
    """How the duration of cycles varies; `per` run: all cycles of a run by the same amount."""

    deviation: Percent
    per: Literal["cycle", "run"] = "cycle"


def _deviation(value: object) -> object:
    return value if isinstance(value, dict) or value is None else {"deviation": value}


class RangeSection(Section):
    """A stretch of the Modbus map."""

    type: Literal["discrete", "coil", "input", "holding"]
    first: int = Field(ge=0, le=65535)
    count: int = Field(ge=1, le=65536)
    area: str
    element: int = Field(0, ge=0)
    access: Literal["r", "rw"] = "r"
    field_window: bool = False


class ModbusSection(Section):
    """The Modbus TCP server."""

    enabled: bool = True
    host: str = "127.0.0.1"
    port: int = Field(default=5020, ge=0, le=65535)
    units: list[Unit] | None = None
    field_window: bool = True
    max_connections: int = Field(default=64, ge=1, le=10_000)
    idle_timeout: PositiveDuration = 60_000_000_000
    requests_per_scan: int | None = Field(default=None, ge=1)
    ranges: list[RangeSection] | None = None


class RealtimeSection(Section):
    """How punctual the daemon's cycle is to be."""

    timer_slack: PositiveDuration = 1
    scheduler: Literal["other", "fifo"] = "other"
    priority: int = Field(default=20, ge=1, le=99)
    cpus: Annotated[list[Annotated[int, Field(ge=0)]], Field(min_length=1)] | None = None
    lock_memory: bool = False
    gc_freeze: bool = True
    reserve: Duration = 200_000
    spin: Duration = 0


class SweepSection(Section):
    """A family of runs, for `plcemu sweep`."""

    until: PositiveDuration | None = None
    runs: int = Field(default=1, ge=1, le=10_000_000)
    seed: int | None = Field(default=None, ge=0, lt=2**63)
    vary: dict[str, Annotated[str, BeforeValidator(_listed)]] = {}
    collect: Texts = []


class PointSection(Section):
    """A port's place in the process image, and engineering units for one raw count."""

    location: ClassVar[str] = ""

    address: str
    scale: Factor = Fraction(1)

    @field_validator("address")
    @classmethod
    def _address(cls, text: str) -> str:
        try:
            found = parse_address(text).area[0]
        except ValueError as problem:
            raise ValueError(f"an address: {problem}") from None
        if found != cls.location:
            raise ValueError(f"an address %{cls.location}...: sensors go to inputs (%I), "
                             "actuators follow outputs (%Q)")
        return text


class InputSection(PointSection):
    """Where a sensor's reading goes."""

    location = "I"


class OutputSection(PointSection):
    """What an actuator follows."""

    location = "Q"


class RetainSection(Section):
    """Where and how often retained variables are kept."""

    enabled: bool = True
    file: str | None = None
    interval: Duration = 1_000_000_000


class ControlSection(Section):
    """The socket of `plcemu control`."""

    enabled: bool = True
    socket: str | None = None


class HistorianSection(Section):
    """The recorder on disk."""

    file: str | None = None
    tags: Texts = []
    keep: PositiveDuration | None = None
    megabytes: int | None = Field(default=1000, ge=1)
    interval: PositiveDuration = 1_000_000_000
    ring: int = Field(default=10_000, ge=1, le=10_000_000)


class AlarmSection(Section):
    """An alarm that a violated property raises."""

    severity: Literal["low", "medium", "high", "critical"] = "high"
    text: str = ""


class RecordSection(Section):
    """A recording around a violation."""

    before: Duration = 5_000_000_000
    after: Duration = 5_000_000_000
    file: str = "{property}-{t}.vcd"


def _alarm(value: object) -> object:
    return {} if value is True else {"severity": value} if isinstance(value, str) else value


class ReactionSection(Section):
    """What follows when a property is violated."""

    set: dict[str, Number] = {}
    alarm: Annotated[AlarmSection, BeforeValidator(_alarm)] | None = None
    stop: bool = False
    record: RecordSection | None = None


def _point(value: object) -> object:
    return {"address": value} if isinstance(value, str) else value


class DeviceSection(Section):
    """How a sensor or actuator is imperfect by nature."""

    noise: float = Field(0.0, ge=0)
    sample: PositiveDuration = SAMPLE_NS
    resolution: float = Field(0.0, ge=0)
    delay: Duration = 0
    drift: float = 0.0
    travel: Duration = 0

    def device(self) -> Device:
        """Return the device as the plant side knows it."""
        return Device(self.noise, self.sample, self.resolution, self.delay, self.drift, self.travel)


class PlantSection(Section):
    """The soft plant and its wiring."""

    model: str
    parameters: dict[str, Any] = {}
    seed: int | None = None
    devices: dict[str, DeviceSection] = {}
    scenario: str | None = None
    time_scale: Factor = Fraction(1)
    inputs: dict[str, Annotated[InputSection, BeforeValidator(_point)]] = {}
    outputs: dict[str, Annotated[OutputSection, BeforeValidator(_point)]] = {}
    period: PositiveDuration | None = None
    output_delay: Literal["none", "cycle"] = "none"


class LimitsSection(Section):
    """Where a proof gives up as inconclusive."""

    states: int = Field(default=5_000_000, ge=1)
    time: PositiveDuration | None = None
    memory_mb: int | None = Field(default=4096, ge=64)


class VerifySection(Section):
    """What `plcemu verify` proves, against which finite plant."""

    abstraction: str | None = None
    parameters: dict[str, Any] = {}
    initial: str | None = None
    merge: Literal["stable", "none"] = "stable"
    fairness: Literal["weak", "strong", "none"] = "weak"
    frozen: str | None = None
    sipn_single_firing: bool | None = None
    monitored: bool = True
    properties: Texts = []
    limits: LimitsSection = LimitsSection()


class StudySection(Section):
    """A study of `plcemu reach`: a parameter varied, an objective's reachable interval drawn."""

    vary: str
    set: list[str] = []
    show: Literal["interval", "range"] = "range"
    within: Annotated[Fraction | None, BeforeValidator(_limit)] = None
    title: str = ""


class ReachSection(Section):
    """Exact reachability."""

    regions: Literal["auto", "zones", "polyhedra"] = "auto"
    states: int = Field(default=200_000, ge=1)
    studies: dict[str, StudySection] = {}

    def study(self, name: str) -> StudySection | None:
        """Return the study of a name, or None."""
        return self.studies.get(name)


class Config(Section):
    """A whole configuration."""

    name: Annotated[str, BeforeValidator(_text)] = ""
    program: Texts
    cycle: PositiveDuration = 10_000_000
    engine: str = "auto"
    sfc_final_scan: bool = False
    budget: Budget = BUDGET
    watchdog: PositiveDuration | None = None
    sipn_single_firing: bool = False
    jitter: Annotated[JitterSection | None, BeforeValidator(_deviation)] = None
    seed: int = Field(0, ge=0, lt=2**63)
    tasks: dict[str, TaskSection] = {}
    safe_outputs: dict[str, Number] = {}
    speed: Factor = Fraction(1)
    modbus: ModbusSection = ModbusSection()
    realtime: RealtimeSection = RealtimeSection()
    plant: PlantSection | None = None
    sweep: SweepSection = SweepSection()
    properties: Texts = []
    plot: dict[str, Texts] = {}
    retain: RetainSection = RetainSection()
    control: ControlSection = ControlSection()
    historian: HistorianSection = HistorianSection()
    reactions: dict[str, ReactionSection] = {}
    verify: VerifySection = VerifySection()
    reach: ReachSection = ReachSection()

    _file: str = PrivateAttr("configuration")
    _places: Mapping[KeyPath, str] = PrivateAttr(default_factory=dict)

    @property
    def file_path(self) -> Path:
        """The file that it was read from."""
        return Path(self._file)

    @property
    def program_paths(self) -> list[Path]:
        """The program's source files."""
        return [Path(p) for p in self.program]

    @property
    def property_paths(self) -> list[Path]:
        """The files of properties."""
        return [Path(p) for p in self.properties]

    @property
    def proof_paths(self) -> list[Path]:
        """The files of properties that are only proved, besides those that are also monitored."""
        return [Path(p) for p in self.verify.properties]

    def mistake(self, path: KeyPath, text: object) -> ConfigError:
        """Return the error of a mistake that shows only when the parts are put together.

        Args:
            path: of the key; where it stands, or the nearest key above it, is told.
            text: what is wrong.
        """
        where = _place(self._file, self._places, path)
        return ConfigError([f"{where}: {'.'.join(path)}: {text}"])


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
        for override in overrides:
            key = _override(values, override)
            places[key] = f"--set {override}"
            if key in _PATH_KEYS:
                _find_beside(values, key, self.file.parent)
        try:
            config = Config.model_validate(values)
        except ValidationError as problems:
            raise ConfigError([problem_text(str(self.file), places, p)
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
        raise ConfigError([f"{where}: extends: found {_shown(base)}, expected a file or folder"])
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


# ---------------------------------------------------------------- --set


def _override(values: dict[str, Any], text: str) -> KeyPath:
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
            inner = _deviation(inner)
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
            keys = _SECTIONS[(*free, "*")].model_fields if len(free) > 1 else ()
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


# ---------------------------------------------------------------- mistakes


def problem_text(file: str, places: Mapping[KeyPath, str], error: Any,
                 known: Callable[[KeyPath], Iterable[str]] | None = None) -> str:
    """Return one line on a mistake that pydantic found: place, key, found, expected.

    Args:
        file: that was read.
        places: of its keys.
        error: as pydantic describes it.
        known: the keys that may stand where one of this path stands.
    """
    location: KeyPath = tuple(str(p) for p in error["loc"] if p != "[key]")
    where, path = _place(file, places, location), ".".join(location)
    if error["type"] == "invalid_key":
        return f"{where}: the key {path} must be a text"
    if error["type"] == "missing":
        return f"{where}: {path} is missing"
    if error["type"] == "extra_forbidden":
        keys = (known or _known_keys)(location)
        return f"{where}: there is no key {path!r}{did_you_mean(location[-1], keys)}"
    return f"{where}: {path}: found {_shown(error['input'])}, expected {_expected(error)}"


def _place(file: str, places: Mapping[KeyPath, str], path: KeyPath) -> str:
    """Return where a key stands, or the nearest key above it that stands anywhere."""
    above = (path[:n] for n in range(len(path), 0, -1))
    return next((places[p] for p in above if p in places), file)


def _shown(value: object) -> str:
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


_SECTIONS: Mapping[KeyPath, type[Section]] = {
    (): Config,
    ("jitter",): JitterSection,
    ("sweep",): SweepSection,
    ("tasks", "*"): TaskSection,
    ("modbus",): ModbusSection,
    ("modbus", "ranges", "*"): RangeSection,
    ("plant",): PlantSection,
    ("plant", "inputs", "*"): InputSection,
    ("plant", "outputs", "*"): OutputSection,
    ("retain",): RetainSection,
    ("control",): ControlSection,
    ("historian",): HistorianSection,
    ("reactions", "*"): ReactionSection,
    ("reactions", "*", "alarm"): AlarmSection,
    ("reactions", "*", "record"): RecordSection,
    ("plant", "devices", "*"): DeviceSection,
    ("realtime",): RealtimeSection,
    ("verify",): VerifySection,
    ("verify", "limits"): LimitsSection,
    ("reach",): ReachSection,
    ("reach", "studies", "*"): StudySection,
}


def _known_keys(location: KeyPath) -> Iterable[str]:
    above = location[:-1]
    section = _SECTIONS.get(above) or _SECTIONS.get((*above[:-1], "*"))
    return section.model_fields if section else ()
