"""The contracts of a finite plant: what a checker, and a scheduler, may ask of a plant.

Where the plant of `plant_sim.contract` moves through time, its abstraction only knows finitely
many states, and lets *actions* happen: a process ends, a level passes a threshold. When they
happen is left open, so every timing of the real plant is among the runs of the abstraction.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Collection, Hashable, Iterable, Mapping, Sequence
from fractions import Fraction
from typing import Any, NamedTuple, Protocol, cast

from plant_sim.contract import Fact, FactValue, PortValue


class Abstraction(Protocol):
    """A finite plant. States and actions are hashable; an action's `str` is shown to the user."""

    @property
    def facts(self) -> tuple[Fact, ...]:
        """What `observe` returns, in a fixed order; the names a property may speak of."""

    def initial(self) -> Iterable[Hashable]:
        """The states that a run may begin in, all actuators off."""

    def name_of(self, state: Any) -> str:
        """An initial state in the user's words, such as `load 2.5 (half: water)`."""

    def sense(self, state: Any) -> Mapping[str, PortValue]:
        """What the sensors read in a state, by port name."""

    def actuate(self, state: Any, values: Mapping[str, PortValue]) -> Hashable:
        """The state once the actuators have these values; all actuators are given."""

    def actions(self, state: Any) -> Sequence[Hashable]:
        """What may happen next by itself; none in a plant at rest."""

    def after(self, state: Any, action: Any) -> Hashable:
        """The state after an action."""

    def observe(self, state: Any) -> Mapping[str, FactValue]:
        """The values of the facts in a state."""

    def pending(self, state: Any) -> Collection[str]:
        """What is under way in a state and, under weak fairness, does not stay so for ever."""

    def done(self, action: Any) -> Collection[str]:
        """What of the pending is brought to its end by an action."""


ABSTRACTIONS: dict[str, str] = {
    "batch_plant": "plant_sim.batch_plant.abstraction:BatchAbstraction",
    "evaporator": "plant_sim.evaporator.abstraction:EvaporatorAbstraction",
}
"""Name of a plant -> "package.module:Class" of its abstraction; imported only when asked for."""


SCHEDULED: dict[str, str] = {
    "batch_plant": "plant_sim.batch_plant.scheduling:BatchScheduling",
}
"""Name of a plant -> "package.module:Class" of what a scheduler may ask of it."""


class AbstractionError(ValueError):
    """There is no such abstraction, or it does not take these parameters."""


class Case(NamedTuple):
    """One initial state to schedule from.

    Attributes:
        name: in the user's words.
        keys: what JSON tells of it, such as `load`.
        parameters: the plant's parameters for it.
        plant: the same initial state of the plant's abstraction.
    """

    name: str
    keys: Mapping[str, Any]
    parameters: Mapping[str, Any]
    plant: Hashable


class Repair(NamedTuple):
    """The smallest change of a controller's priorities that makes it optimal.

    Attributes:
        changes: it; pairs (first, second) of processes, the first now goes before the second.
        period: what it gives, in units of time per batch.
        tried: how many different behaviours fixed priorities can have.
    """

    changes: tuple[tuple[str, str], ...]
    period: Fraction
    tried: int


class Scheduling(Protocol):
    """What a scheduler asks of a plant whose processes may be started at will."""

    counted: str
    """The process whose start counts as a batch."""

    def cases(self, which: str) -> Sequence[Case]:
        """The initial states: `configured`, `all`, or a load; raises AbstractionError."""

    def protocol(self, case: Case) -> Any:
        """The timed system that begins in a case's initial state, with its `unit_s`."""

    def durations(self, case: Case) -> Mapping[str, int]:
        """How long each process takes, in units of time."""

    def users(self) -> Mapping[str, tuple[str, ...]]:
        """For each process the resources that it uses alone while it runs."""

    def why_none(self, case: Case) -> str:
        """Why nothing can be produced for ever from a case, in words."""

    def repair(self, case: Case, period: Fraction) -> Repair | None:
        """The best change of the controller's priorities; None if its own run is not as known.

        Args:
            case: the initial state.
            period: of the controller, in units of time per batch.
        """


def load_scheduling(name: str, parameters: Mapping[str, object]) -> Scheduling:
    """What a scheduler may ask of a plant. Raises AbstractionError."""
    return cast(Scheduling, _load(name, SCHEDULED, "cannot be scheduled")(parameters))


def load_abstraction(name: str, parameters: Mapping[str, object]) -> Abstraction:
    """A plant's abstraction, or that of a dotted "package.module:Class".

    Raises AbstractionError.
    """
    return cast(Abstraction, _load(name, ABSTRACTIONS, "has no abstraction")(parameters))


def _load(name: str, table: Mapping[str, str], lack: str) -> Callable[..., object]:
    module_name, colon, class_name = table.get(name, name).partition(":")
    if not colon:
        raise AbstractionError(f"plant {name} {lack}; known: {', '.join(sorted(table))}, or "
                               "package.module:Class")
    try:
        return cast("Callable[..., object]",
                    getattr(importlib.import_module(module_name), class_name))
    except (ImportError, AttributeError) as error:
        raise AbstractionError(f"{name}: {error}") from error
