"""The contract of a finite plant: what a checker may ask of a plant's abstraction.

Where the plant of `plant_sim.contract` moves through time, its abstraction only knows finitely
many states, and lets *actions* happen: a process ends, a level passes a threshold. When they
happen is left open, so every timing of the real plant is among the runs of the abstraction.
"""

from __future__ import annotations

import importlib
from collections.abc import Collection, Hashable, Iterable, Mapping, Sequence
from typing import Any, Protocol, cast

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
}
"""Name of a plant -> "package.module:Class" of its abstraction; imported only when asked for."""


class AbstractionError(ValueError):
    """There is no such abstraction, or it does not take these parameters."""


def load_abstraction(name: str, parameters: Mapping[str, object]) -> Abstraction:
    """A plant's abstraction, or that of a dotted "package.module:Class".

    Raises AbstractionError.
    """
    module_name, colon, class_name = ABSTRACTIONS.get(name, name).partition(":")
    if not colon:
        raise AbstractionError(f"plant {name} has no abstraction; known: "
                               f"{', '.join(sorted(ABSTRACTIONS))}, or package.module:Class")
    try:
        made = getattr(importlib.import_module(module_name), class_name)
    except (ImportError, AttributeError) as error:
        raise AbstractionError(f"{name}: {error}") from error
    return cast(Abstraction, made(parameters))
