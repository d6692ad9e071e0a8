"""Exact reachability of a configuration: where its plant can get under its compiled program.

A study varies one parameter and asks at each value; the program is compiled and scanned once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from fractions import Fraction
from itertools import islice
from typing import Any

from plant_sim.linear_automaton import Automaton, AutomatonError
from plcemu.base.errors import ConfigError, PlcemuError
from plcemu.lang.compile import compile_program
from plcemu.runtime.config import Config, ConfigText
from plcemu.runtime.variation import Variation, VariationError
from plcemu.runtime.wiring import make_coupling, make_plant, make_resource
from plcemu.verify.hybrid.controller import ProgramController
from plcemu.verify.hybrid.polyhedra import Bounds
from plcemu.verify.hybrid.reach import Cyclic, Reached, reach

FEW = 64
"""Values of a study up to which no further processes are started."""


@dataclass(frozen=True, slots=True)
class Found:
    """What can be reached at one value of a study.

    Attributes:
        value: of the varied parameter, as text; empty without a variation.
        bounds: of the objective, or None where it is never met.
        pieces: the intervals in between that can be reached.
        conclusive: whether everything was explored.
        states: symbolic states.
        reason: why it is not conclusive.
    """

    value: str
    bounds: Bounds | None
    pieces: tuple[Bounds, ...]
    conclusive: bool
    states: int
    reason: str

    @property
    def range(self) -> Fraction | None:
        """Return the width of the bounds."""
        if self.bounds is None or self.bounds.low is None or self.bounds.high is None:
            return None
        return self.bounds.high - self.bounds.low


class Question:
    """Where one objective of a configuration's plant can get.

    Args:
        text: of the configuration.
        overrides: as of `--set`.
        objective: its name, or None for the plant's first.

    Raises:
        CompileError: the program is wrong.
        ConfigError: the configuration is wrong, or its plant has no exact model or no such
            objective.
        PlcemuError: the program cannot be explored, for example because it measures time.

    Attributes:
        objective: its name.
        unit: of its values.
    """

    def __init__(self, text: ConfigText, overrides: Sequence[str],
                 objective: str | None = None) -> None:
        self._text, self._overrides = text, tuple(overrides)
        config = text.config(overrides)
        goals = _automaton(config).objectives
        chosen = [g for g in goals if objective is None or g.name == objective]
        if not chosen:
            raise config.mistake(("plant", "model"), f"found no objective "
                                 f"{objective or 'at all'}, expected one of "
                                 f"{', '.join(g.name for g in goals) or 'none'}")
        self.objective, self.unit = chosen[0].name, chosen[0].unit
        self._controller = _controller(config)

    def at(self, value: str = "", name: str = "") -> Found:
        """Return what can be reached with one more override; raises as the class does."""
        config = self._text.config([*self._overrides, *([f"{name}={value}"] if name else [])])
        automaton = _automaton(config)
        section = config.reach
        try:
            found = reach(automaton, Cyclic(self._controller, _period(config)),
                          kind=section.regions, limit=section.states)
        except AutomatonError as problem:
            raise config.mistake(("plant",), problem) from None
        return self._told(value, found)

    def _told(self, value: str, found: Reached) -> Found:
        return Found(value, found.bounds(self.objective), tuple(found.pieces(self.objective)),
                     found.conclusive, found.states, found.reason)


def _automaton(config: Config) -> Automaton:
    plant = make_plant(config)
    describe = getattr(plant, "automaton", None)
    if describe is None:
        raise config.mistake(("plant", "model"), f"the plant {plant.name} has no exact model; "
                             "a plant has one if it has a method automaton() "
                             "(plant_sim.linear_automaton)")
    made = describe()
    assert isinstance(made, Automaton)
    return made


def _controller(config: Config) -> ProgramController:
    program = compile_program(config.program_paths, final_scan=config.sfc_final_scan)
    coupling = make_coupling(config)
    if config.plant is not None and config.plant.output_delay != "cycle":
        raise config.mistake(("plant", "output_delay"), "found none, expected cycle: in the exact "
                             "model outputs take effect at the end of the cycle")
    return ProgramController(make_resource(config, program), coupling.inputs, coupling.outputs)


def _period(config: Config) -> tuple[Fraction, Fraction]:
    """Return the shortest and the longest duration of a cycle, in s."""
    cycle = Fraction(config.cycle, 10**9)
    deviation = config.jitter.deviation if config.jitter is not None else Fraction(0)
    return cycle * (1 - deviation), cycle * (1 + deviation)


# ------------------------------------------------------------ studies


def study(text: ConfigText, overrides: Sequence[str], variation: Variation,
          objective: str | None = None, jobs: int = 1,
          on_progress: Callable[[int, int], None] | None = None) -> list[Found]:
    """Return what can be reached at every value of a variation, in its order.

    Args:
        text: of the configuration.
        overrides: as of `--set`.
        variation: of one parameter.
        objective: see `Question`.
        jobs: processes to use.
        on_progress: told how many values are done, and of how many.

    Raises:
        PlcemuError: as `Question` does, for any value.
    """
    count = len(variation.values)
    if variation.is_range:
        raise VariationError(f"{variation.name}=...", "found a range to draw from, expected a list "
                             "or a grid with a step")
    if jobs <= 1 or count <= FEW:
        question = Question(text, overrides, objective)
        answers: Iterator[Found] = (question.at(v, variation.name) for v in variation.values)
        return list(_counted(answers, count, on_progress))
    start = text, tuple(overrides), objective, variation.name
    with ProcessPoolExecutor(jobs, initializer=_prepare, initargs=start) as pool:
        answers = pool.map(_answer, variation.values, chunksize=max(1, min(32, count // 16)))
        return list(_counted(answers, count, on_progress))


def _counted(answers: Iterator[Found], count: int,
             on_progress: Callable[[int, int], None] | None) -> Iterator[Found]:
    for n, answer in enumerate(islice(answers, count), 1):
        if on_progress is not None:
            on_progress(n, count)
        yield answer


_worker: dict[str, Any] = {}


def _prepare(text: ConfigText, overrides: Sequence[str], objective: str | None,
             name: str) -> None:
    _worker["question"] = Question(text, overrides, objective)
    _worker["name"] = name


def _answer(value: str) -> Found:
    try:
        found: Found = _worker["question"].at(value, _worker["name"])
    except ConfigError as problem:
        # Rebuilt from its text: the error of another process arrives by pickling.
        raise PlcemuError(str(problem)) from None
    return found


# ------------------------------------------------------------ within a limit


@dataclass(frozen=True, slots=True)
class Stretch:
    """Neighbouring values of a study at which a condition holds."""

    first: str
    last: str


def within(answers: Sequence[Found], limit: Fraction) -> list[Stretch]:
    """Return the stretches of values at which the range is at most a limit and proved to be."""
    stretches: list[Stretch] = []
    begun: Found | None = None
    last: Found | None = None
    for answer in answers:
        width = answer.range
        if answer.conclusive and width is not None and width <= limit:
            begun, last = begun or answer, answer
        elif begun is not None and last is not None:
            stretches.append(Stretch(begun.value, last.value))
            begun = None
    if begun is not None and last is not None:
        stretches.append(Stretch(begun.value, last.value))
    return stretches
