"""The scans of a step: from a state and what the plant does to the next state of the closed loop.

This is the readable version, one scan after another. `plcemu.verify.rounds` makes the scans of many
steps at once, and comes to the same states.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator
from typing import NamedTuple

from plcemu.base.errors import PlcemuError, ProgramFault
from plcemu.verify.machine import ScanMachine
from plcemu.verify.views import Outcome, View, Views


class State(NamedTuple):
    """A state of the closed loop.

    Attributes:
        memory: the block, reduced to what matters.
        plant: the plant's state.
        seen: bit n is set if the watched formula n held in a scan of the step that led here.
        fault: why the program stopped; else empty.
        clocks: where time is kept, the values of clocks; see `plcemu.verify.timed.loop`.
    """

    memory: bytes
    plant: Hashable
    seen: int = 0
    fault: str = ""
    clocks: tuple[int, ...] = ()


Trail = tuple[list[tuple[bytes, Hashable]], Hashable, str]
"""Scans as (memory after it, the plant whose readings it saw), the plant after them, and why the
program faulted in the one after the last; empty if it did not."""


Start = tuple[bytes, Hashable]
"""Where a step's scans begin: memory before, and the plant whose readings the first one sees."""

SETTLES_WITHIN = 1000
"""Scans after which the loop must rest if nothing happens by itself."""


class DoesNotSettle(PlcemuError):
    """The loop goes on changing although nothing happens by itself, so scans cannot be merged."""

    def __init__(self) -> None:
        super().__init__(f"the loop still changes after {SETTLES_WITHIN} scans in which nothing "
                         "happens by itself; verify every scan: merge: none")


class Settling:
    """Makes steps: scans until the loop rests, or a single one.

    It rests if neither the plant changes nor anything in memory that matters.

    Args:
        machine: the program's scan.
        views: the plant, and what is watched.
        told: the watched formulas, as bits, that are told in `State.seen`.
        once: whether every scan is a step of its own.
    """

    def __init__(self, machine: ScanMachine, views: Views, told: int, once: bool) -> None:
        self.machine, self.views, self.told, self.once = machine, views, told, once

    def settled(self, starts: Iterable[Start], elapsed_ns: int) -> Iterator[State]:
        """Yield the states that steps lead to.

        Raises:
            DoesNotSettle: the next one leads to none.
        """
        for memory, plant in starts:
            yield self.last(self.step(memory, plant, elapsed_ns), memory)

    def step(self, memory: bytes, plant: Hashable, elapsed_ns: int) -> Trail:
        """Return the scans of a step; the plant follows the outputs after each."""
        scans: list[tuple[bytes, Hashable]] = []
        machine, views = self.machine, self.views
        view, before = views.of(plant), machine.reduced(memory)
        try:
            for _ in range(SETTLES_WITHIN):
                memory = machine.scan(memory, views.image(view), elapsed_ns)
                scans.append((memory, view.state))
                after = machine.reduced(memory)
                _, following = self.outcome(after, view)
                rests = following is view and after == before
                view, before = following, after
                if rests or self.once:
                    return scans, view.state, ""
        except ProgramFault as fault:
            return scans, view.state, reason_of(fault)
        raise DoesNotSettle

    def last(self, step: Trail, memory: bytes) -> State:
        """Return the state that a step's scans lead to from a memory.

        After a fault memory is as before the scan that brought it about.
        """
        scans, plant, fault = step
        seen = 0
        for memory, seen_plant in scans:
            seen |= self.outcome(self.machine.reduced(memory), self.views.of(seen_plant))[0]
        return State(self.machine.reduced(memory), plant, seen & self.told, fault)

    def outcome(self, memory: bytes, view: View) -> Outcome:
        """Return what a scan means that saw a plant's state, and left memory so."""
        return self.views.outcome(view, bytes([memory[n] for n in self.views.told]))


def reason_of(fault: ProgramFault) -> str:
    """Return why a program stopped, as states tell it."""
    return fault.reason + (f" in {fault.pou}" if fault.pou else "")
