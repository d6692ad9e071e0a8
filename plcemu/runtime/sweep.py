"""Sweeps: a family of runs of one configuration in virtual time, over parameters and chance.

A run is wholly given by the configuration and its overrides, so it makes no difference where and in
which order runs are executed (`plcemu.runtime.workers`), and each can be repeated with `simulate`.
"""

from __future__ import annotations

import pickle
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import islice, product
from math import prod
from typing import Any

from plant_sim.chance import uniform
from plcemu.base.errors import PlcemuError, UnknownNameError
from plcemu.base.tags import TagTable
from plcemu.base.trace import Frame
from plcemu.base.types import Value
from plcemu.runtime.config import Config, ConfigText
from plcemu.runtime.system import Parts, System, load_parts
from plcemu.runtime.variation import Variation
from plcemu.runtime.wiring import make_plant

RUNS_LIMIT = 10_000_000
"""Runs of one sweep."""

CHECKED = 2_000
"""Combinations that are checked before the first run; later ones tell their mistakes as results."""

_MEASURE = re.compile(r"(min|max|last)\s*\((.+)\)", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Measure:
    """What is collected of each run: a tag's last value, or the least or greatest it had."""

    label: str
    tag: str
    kind: str = "last"

    @classmethod
    def parse(cls, text: str) -> Measure:
        """Read `TAG`, `min(TAG)` or `max(TAG)`."""
        match = _MEASURE.fullmatch(text.strip())
        if match is None:
            return cls(text.strip(), text.strip())
        return cls(text.strip(), match[2].strip(), match[1].lower())


@dataclass(frozen=True, slots=True)
class Run:
    """One run: its number, and the parameters that make it, in the order of `--set`."""

    number: int
    point: tuple[str, ...]
    parameters: Mapping[str, str]

    @property
    def overrides(self) -> list[str]:
        """The parameters as overrides of the configuration."""
        return [f"{name}={value}" for name, value in self.parameters.items()]


@dataclass(frozen=True, slots=True)
class Design:
    """Which runs a sweep has.

    Attributes:
        variations: what is varied; lists and grids are combined with each other.
        runs: how often each combination is run, each time with other chance.
        seed: of all chance; None leaves a single run of each combination its configured seed.
    """

    variations: tuple[Variation, ...]
    runs: int = 1
    seed: int | None = None

    @property
    def grid(self) -> list[Variation]:
        """The variations that are lists or grids."""
        return [v for v in self.variations if not v.is_range]

    @property
    def total(self) -> int:
        """How many runs there are."""
        return prod(len(v.values) for v in self.grid) * self.runs

    def __iter__(self) -> Iterator[Run]:
        """Yield every run, combination by combination."""
        is_drawn = self.seed is not None or self.runs > 1 or len(self.grid) < len(self.variations)
        seed, number = self.seed or 0, 0
        for point in product(*(v.values for v in self.grid)):
            for k in range(self.runs):
                values = dict(zip((v.name for v in self.grid), point, strict=True))
                parameters = {v.name: values.get(v.name) or v.draw(seed, k, *point)
                              for v in self.variations}
                if is_drawn and "seed" not in parameters:
                    parameters["seed"] = str(int(uniform(seed, "run", k, *point) * 2**53))
                yield Run(number, point, parameters)
                number += 1

    def corners(self) -> Iterator[Run]:
        """Yield runs whose configurations are right if those of all runs are: ranges at an end."""
        for point in product(*(v.values for v in self.grid)):
            for end in (0, 1) if len(self.grid) < len(self.variations) else (0,):
                values = dict(zip((v.name for v in self.grid), point, strict=True))
                yield Run(0, point, {v.name: values.get(v.name) or v.ends[end]
                                     for v in self.variations})


@dataclass(frozen=True)
class Plan:
    """All that a worker needs to execute any run; files are needed for plants of one's own only.

    Attributes:
        text: the configuration, read.
        overrides: of all runs, before those of each.
        until_ns: how long a run is, in the PLC's time.
        measures: what is collected.
        parts: compiled programs and properties, by what they were made from.
    """

    text: ConfigText
    overrides: tuple[str, ...]
    until_ns: int
    measures: tuple[Measure, ...]
    parts: Mapping[tuple[Any, ...], Parts]

    def config(self, run: Run) -> Config:
        """Return the configuration of a run."""
        return self.text.config([*self.overrides, *run.overrides])

    def execute(self, run: Run) -> Result:
        """Execute a run from its cold start."""
        config = self.config(run)
        try:
            system = System(config, parts=self.parts.get(parts_key(config)))
            extremes = _Extremes.of(system, self.measures)
            system.cycle.run_virtual(self.until_ns)
        except PlcemuError as problem:
            return Result(run, error=str(problem))
        return self._result(run, system, extremes)

    def _result(self, run: Run, system: System, extremes: _Extremes) -> Result:
        last = system.cycle.values()
        values = {m.label: extremes.value(m) if m.kind != "last"
                  else last[system.cycle.tags.find(m.tag)] for m in self.measures}
        fault = system.resource.fault
        return Result(run, values, {r.name: r.verdict.value
                                    for r in system.cycle.suite.results()},
                      str(fault) if fault is not None else "")


@dataclass(frozen=True, slots=True)
class Result:
    """What a run gave.

    Attributes:
        run: which.
        values: collected, by the measures' labels.
        verdicts: by property.
        error: why the program faulted or the run could not be executed, or empty.
    """

    run: Run
    values: Mapping[str, Value | None] = field(default_factory=dict)
    verdicts: Mapping[str, str] = field(default_factory=dict)
    error: str = ""

    def as_json(self) -> dict[str, Any]:
        """Return plain values."""
        document: dict[str, Any] = {
            "run": self.run.number, "parameters": dict(self.run.parameters),
            "values": dict(self.values), "verdicts": dict(self.verdicts)}
        if self.error:
            document["error"] = self.error
        return document


class _Extremes:
    """Follows the least and greatest values of tags; it observes only if it is asked for any."""

    def __init__(self, tags: TagTable, wanted: Sequence[Measure]) -> None:
        self._indices = {m.label: tags.find(m.tag) for m in wanted}
        self._found: dict[int, tuple[Value, Value]] = {}

    @classmethod
    def of(cls, system: System, measures: Sequence[Measure]) -> _Extremes:
        made = cls(system.cycle.tags, [m for m in measures if m.kind != "last"])
        if made._indices:
            system.cycle.observers.append(made)
        return made

    def observe(self, frame: Frame) -> None:
        """Take one frame."""
        for index, value in frame.changes:
            if value is None:  # bad quality: not known, so neither least nor greatest
                continue
            low, high = self._found.get(index, (value, value))
            self._found[index] = min(low, value), max(high, value)

    def value(self, measure: Measure) -> Value:
        """Return what a measure asks for."""
        low, high = self._found[self._indices[measure.label]]
        return low if measure.kind == "min" else high


def parts_key(config: Config) -> tuple[Any, ...]:
    """Return what a configuration's program and properties are made from."""
    return (tuple(config.program), tuple(config.properties), config.sfc_final_scan,
            config.sipn_single_firing)


def make_plan(text: ConfigText, overrides: Sequence[str], until_ns: int, design: Design,
              collect: Sequence[str]) -> Plan:
    """Check every run's configuration, compile what they need, and return the plan.

    Without `collect` all facts of the plant are collected.

    Raises:
        ConfigError: a value of a run does not fit the configuration.
        CompileError: a program or property is wrong.
        PlcemuError: too many runs, or a tag that does not exist.
    """
    if design.total > RUNS_LIMIT:
        raise PlcemuError(f"the sweep has {design.total} runs, the limit is {RUNS_LIMIT}")
    plan = Plan(text, tuple(overrides), until_ns, (), {})
    parts: dict[tuple[Any, ...], Parts] = {}
    tried: dict[tuple[Any, ...], System] = {}
    for run in islice(design.corners(), CHECKED):
        config = plan.config(run)
        if config.plant is not None:
            make_plant(config)
        key = parts_key(config)
        if key not in parts:
            parts[key] = load_parts(config)
            tried[key] = System(config, parts=parts[key])
    measures = tuple(Measure.parse(each) for each in collect)
    for system in tried.values():
        measures = measures or _facts_of(system)
        _check_measures(measures, system.cycle.tags)
    return Plan(text, tuple(overrides), until_ns, measures, parts)


def _facts_of(system: System) -> tuple[Measure, ...]:
    if system.plant is None:
        return ()
    names = [f"plant.{fact.name}" for fact in system.plant.coupling.plant.facts]
    return tuple(Measure(name, name) for name in names)


def _check_measures(measures: Sequence[Measure], tags: TagTable) -> None:
    for measure in measures:
        try:
            tags.find(measure.tag)
        except UnknownNameError as problem:
            raise PlcemuError(f"--collect {measure.label}: {problem}") from None


# ---------------------------------------------------------------- in workers


def packed(plan: Plan) -> bytes:
    """Return a plan as bytes, for workers."""
    return pickle.dumps(plan)


@lru_cache(maxsize=2)
def _unpacked(data: bytes) -> Plan:
    """Return a plan; a worker unpacks and compiles it once for all its runs."""
    plan: Plan = pickle.loads(data)
    return plan


def execute_chunk(runs: Sequence[Run], plan: bytes) -> list[Result]:
    """Execute runs of a packed plan, in a worker."""
    unpacked = _unpacked(plan)
    return [unpacked.execute(run) for run in runs]


def chunks(design: Design, size: int) -> Iterator[list[Run]]:
    """Yield the runs in stretches of a size."""
    runs = iter(design)
    while chunk := list(islice(runs, size)):
        yield chunk
