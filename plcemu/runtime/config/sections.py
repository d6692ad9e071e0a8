"""The sections of a configuration: which keys there are, and what each may hold."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from fractions import Fraction
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, get_args, get_origin

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, PrivateAttr, field_validator

from plant_sim.devices import SAMPLE_NS, Device
from plcemu.base.areas import parse_address
from plcemu.base.errors import ConfigError
from plcemu.engine.interpreter import BUDGET
from plcemu.runtime.config.mistakes import place_of
from plcemu.runtime.config.quantities import (
    Budget,
    Duration,
    Factor,
    Number,
    OptionalFactor,
    Percent,
    PositiveDuration,
    Text,
    TextOfList,
    Texts,
    Unit,
)
from plcemu.runtime.yamltext import KeyPath


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


def deviation_alone(value: object) -> object:
    """Take the short form of a jitter, its deviation alone, for the long one."""
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
    vary: dict[str, TextOfList] = {}
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
    merge: Literal["stable", "none", "timed"] = "stable"
    time: Literal["auto", "integer", "zones"] = "auto"
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
    within: OptionalFactor = None
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

    name: Text = ""
    program: Texts
    cycle: PositiveDuration = 10_000_000
    engine: str = "auto"
    sfc_final_scan: bool = False
    budget: Budget = BUDGET
    watchdog: PositiveDuration | None = None
    sipn_single_firing: bool = False
    jitter: Annotated[JitterSection | None, BeforeValidator(deviation_alone)] = None
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
    def title(self) -> str:
        """The name, or that of the folder where the configuration stands."""
        return self.name or self.file_path.resolve().parent.name

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
        where = place_of(self._file, self._places, path)
        return ConfigError([f"{where}: {'.'.join(path)}: {text}"])


# ---------------------------------------------------------------- which keys stand where


def section_at(path: KeyPath) -> type[Section] | None:
    """Return the section whose keys stand below a path; None if it holds no keys of ours."""
    section: type[Section] = Config
    keys = iter(path)
    for key in keys:
        field = section.model_fields.get(key)
        inner = _section_in(field.annotation) if field else None
        if field is None or inner is None:
            return None
        section = inner
        if _holds_many(field.annotation):
            next(keys, None)  # a name of the user's own, or a place in a list
    return section


def known_keys(path: KeyPath) -> Iterable[str]:
    """Return the keys that may stand where one of this path stands."""
    section = section_at(path[:-1])
    return section.model_fields if section else ()


def _section_in(annotation: Any) -> type[Section] | None:
    if isinstance(annotation, type) and issubclass(annotation, Section):
        return annotation
    return next(filter(None, map(_section_in, get_args(annotation))), None)


def _holds_many(annotation: Any) -> bool:
    return get_origin(annotation) in (dict, list) or any(map(_holds_many, get_args(annotation)))
