"""What follows when a property is violated: a tag is set, an alarm raised, the PLC stopped.

Monitors only look. A reaction is an outsider like any client: what it sets waits for the next scan.
Only the stop is more: it is the runtime's own command, carried out before the violating scan ends
and before anybody outside, the plant included, has seen its outputs (docs/timing.md).
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

from plcemu.base.errors import PlcemuError
from plcemu.base.time import format_duration
from plcemu.base.types import Value
from plcemu.monitor.verdict import Verdict
from plcemu.runtime.access import TagAccess
from plcemu.runtime.alarms import Alarm, AlarmError, Alarms, AlarmState

if TYPE_CHECKING:
    from plcemu.runtime.cycle import Cycle

_LOG = logging.getLogger("plcemu.reactions")


class InterlockError(PlcemuError):
    """The PLC may not run: it was stopped by a reaction whose alarm nobody has acknowledged."""


@dataclass(frozen=True, slots=True)
class Reaction:
    """What follows when one property is violated.

    Attributes:
        name: of the property.
        sets: tags and the values that they get, once.
        stop: whether the PLC goes to STOP and stays there until the alarm is acknowledged.
        alarm: raised; there is one for each stop.
        record: starts a recording; called with the name and the instant.
    """

    name: str
    sets: Mapping[str, Value] = field(default_factory=dict)
    stop: bool = False
    alarm: Alarm | None = None
    record: Callable[[str, int], None] | None = None


class Checkpoint(NamedTuple):
    """Which reactions have come, and how the alarms stand."""

    fired: frozenset[str]
    alarms: tuple[Alarm, ...]


class Reactions:
    """Watches verdicts for a cycle, and reacts.

    Args:
        reactions: one a property at most.

    Attributes:
        alarms: that they raise.
    """

    PORT = "reaction"

    def __init__(self, reactions: Sequence[Reaction]) -> None:
        self._reactions = list(reactions)
        self.alarms = Alarms([r.alarm for r in reactions if r.alarm is not None])
        self._fired: set[str] = set()
        self._undecided = -1
        self._cycle: Cycle | None = None
        self._access: TagAccess | None = None

    def join(self, cycle: Cycle) -> None:
        """React to a cycle's monitors from now on.

        Raises:
            PlcemuError: a tag to be set does not exist or cannot have the value.
        """
        self._cycle = cycle
        for reaction in self._reactions:
            for name, value in reaction.sets.items():
                self._tags(cycle).check(name, value)
        cycle.reactions = self

    def _tags(self, cycle: Cycle) -> TagAccess:
        """Return the access to the tags of the program that runs now."""
        if self._access is None or not self._access.is_of(cycle.resource.memory):
            self._access = TagAccess(cycle.resource.memory, cycle.exchange, self.PORT)
        return self._access

    # ------------------------------------------------------------ in the lap

    def after_judging(self, t_ns: int) -> None:
        """React to what was found violated in this lap; clear what was acknowledged and is not."""
        cycle = self._cycle
        assert cycle is not None
        undecided = cycle.suite.undecided
        if undecided == self._undecided and not self.alarms.acknowledged:
            return
        self._undecided = undecided
        violated = self._violated(cycle)
        for reaction in self._reactions:
            if reaction.name in violated and reaction.name not in self._fired:
                self._fire(cycle, reaction, t_ns)
            elif reaction.alarm is not None and reaction.name not in violated and \
                    self.alarms[reaction.name].state is AlarmState.ACKNOWLEDGED:
                self.alarms.set_state(reaction.name, AlarmState.CLEARED, t_ns)

    @staticmethod
    def _violated(cycle: Cycle) -> set[str]:
        verdicts = cycle.suite.verdicts()
        return {p.name for p, verdict in zip(cycle.suite.properties, verdicts, strict=True)
                if verdict == Verdict.VIOLATED.value}

    def _fire(self, cycle: Cycle, reaction: Reaction, t_ns: int) -> None:
        self._fired.add(reaction.name)
        _LOG.warning("%s is violated at %s: %s", reaction.name, format_duration(t_ns),
                     _deeds(reaction))
        if reaction.alarm is not None:
            self.alarms.set_state(reaction.name, AlarmState.RAISED, t_ns)
        if reaction.stop:
            cycle.stop()
        for name, value in reaction.sets.items():
            try:
                self._tags(cycle).write(name, value)
            except PlcemuError as problem:  # after an online change, or the queue is full
                _LOG.error("%s: cannot set %s: %s", reaction.name, name, problem)
        if reaction.record is not None and cycle.observers:
            reaction.record(reaction.name, t_ns)

    def must_look(self) -> bool:
        """Whether the next scan matters: an alarm's state has not been shown, or may be cleared."""
        return self.alarms.changed or self.alarms.acknowledged

    # ------------------------------------------------------------ from outside, between scans

    def acknowledge(self, name: str) -> None:
        """Acknowledge an alarm; its property is judged anew from now on.

        Raises:
            AlarmError: there is no such alarm, or it is not raised.
        """
        cycle = self._cycle
        assert cycle is not None
        alarm = self.alarms[name]
        if alarm.state is not AlarmState.RAISED:
            raise AlarmError(f"alarm {alarm.name} is {alarm.state.value}, not raised")
        self.alarms.set_state(alarm.name, AlarmState.ACKNOWLEDGED, cycle.now_ns)
        self._fired.discard(alarm.name)
        cycle.judge_anew(alarm.name)

    def check_may_run(self) -> None:
        """Let the PLC go to RUN, unless a stop is not acknowledged.

        Raises:
            InterlockError: it was stopped by a reaction whose alarm is still raised.
        """
        holding = [r.name for r in self._reactions if r.stop and r.alarm is not None
                   and self.alarms[r.name].state is AlarmState.RAISED]
        if holding:
            raise InterlockError(f"the PLC was stopped because {', '.join(holding)} "
                                 f"{'was' if len(holding) == 1 else 'were'} violated; acknowledge "
                                 "the alarm first (plcemu control ack NAME)")

    # ------------------------------------------------------------ checkpoints

    def checkpoint(self) -> Checkpoint:
        """Return the whole state but for recordings."""
        return Checkpoint(frozenset(self._fired), self.alarms.checkpoint())

    def return_to(self, point: Checkpoint) -> None:
        """Take up the state of a checkpoint."""
        self._fired, self._undecided = set(point.fired), -1
        self.alarms.return_to(point.alarms)


def _deeds(reaction: Reaction) -> str:
    deeds = [f"{name} is set to {value}" for name, value in reaction.sets.items()]
    deeds += ["the PLC is stopped"] if reaction.stop else []
    deeds += ["an alarm is raised"] if reaction.alarm is not None else []
    deeds += ["a recording is made"] if reaction.record is not None else []
    return ", ".join(deeds) or "nothing follows"
