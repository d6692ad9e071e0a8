"""The transition system: all that checkers and schedulers know of what they judge.

States and actions are hashable. A program becomes one through `plcemu.verify.loop`, whose `next`
is the real scan, so that what is proved is what runs.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Iterable, Iterator, Sequence
from typing import Generic, Protocol, TypeVar, runtime_checkable

S = TypeVar("S", bound=Hashable)
A = TypeVar("A", bound=Hashable)
_S = TypeVar("_S", bound=Hashable, contravariant=True)
_A = TypeVar("_A", bound=Hashable, contravariant=True)
_Out = TypeVar("_Out", bound=Hashable, covariant=True)


class TransitionSystem(Protocol[S, A]):
    """States, and what may happen in each."""

    def initial(self) -> Iterable[S]:
        """The states that a run may begin in."""

    def actions(self, state: S) -> Sequence[A]:
        """What may happen in a state; none where a run stays for ever."""

    def next(self, state: S, action: A) -> S:
        """The state after an action."""


@runtime_checkable
class Expanding(TransitionSystem[S, A], Protocol[S, A]):
    """A transition system that is faster for many states at once than for one after another."""

    def expand(self, states: Iterable[S]) -> Iterator[list[tuple[A, S]]]:
        """For each state, its actions and the states after them."""

    def future(self, state: S) -> Hashable:
        """What decides how a run goes on: where it is equal, so are actions and next states."""


class OneByOne(Generic[S, A]):
    """Any transition system as one that is asked for many states at once.

    Args:
        system: which it is.
    """

    def __init__(self, system: TransitionSystem[S, A]) -> None:
        self._system = system
        self.initial, self.actions, self.next = system.initial, system.actions, system.next

    def expand(self, states: Iterable[S]) -> Iterator[list[tuple[A, S]]]:
        """For each state, its actions and the states after them."""
        for state in states:
            yield [(action, self.next(state, action)) for action in self.actions(state)]

    def future(self, state: S) -> Hashable:
        """The state itself."""
        return state


@runtime_checkable
class Fair(Protocol[_S, _A]):
    """What may be pending in a state, and which actions bring it about.

    Weak fairness: nothing stays pending for ever without being done.
    """

    def pending(self, state: _S) -> Collection[str]:
        """What is under way in a state."""

    def done(self, action: _A) -> Collection[str]:
        """What of the pending an action brings about."""


class Move(Protocol[_Out]):
    """What may happen in a state of a timed system: how long it takes, and what it leads to."""

    @property
    def starts(self) -> tuple[str, ...]:
        """What starts at its beginning, by name."""

    @property
    def units(self) -> int:
        """How long it takes, in whole units of time; at least 1."""

    @property
    def batches(self) -> int:
        """How much it produces; it counts at the move's beginning."""

    @property
    def after(self) -> _Out:
        """The state it leads to."""


class Timed(Protocol[S]):
    """A transition system whose moves take time and produce something."""

    def initial(self) -> Sequence[S]:
        """The states that a run may begin in."""

    def moves(self, state: S) -> Sequence[Move[S]]:
        """All moves of a state; none where nothing can happen any more."""
