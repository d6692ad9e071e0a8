"""Alarms with acknowledgement: raised by a violated property, until a person has seen to it.

    normal → raised → acknowledged → cleared → raised …

Acknowledging lets the property be judged anew, from that instant on. If it is violated again the
alarm is raised again; else it is cleared with the next scan. (After ISA-18.2, without shelving.)
"""

from __future__ import annotations

import enum
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from plcemu.base.errors import PlcemuError, did_you_mean
from plcemu.base.tags import Tag
from plcemu.base.time import NS_PER_S
from plcemu.base.types import Value

JOURNAL = 1000
"""Changes of alarms that are remembered; the oldest are forgotten."""


class AlarmError(PlcemuError):
    """An alarm that is not there, or that needs no acknowledgement."""


class AlarmState(enum.StrEnum):
    """How an alarm stands."""

    NORMAL = "normal"
    RAISED = "raised"
    ACKNOWLEDGED = "acknowledged"
    CLEARED = "cleared"


@dataclass(frozen=True, slots=True)
class Alarm:
    """One alarm.

    Attributes:
        name: of the property that raises it.
        severity: `low`, `medium`, `high` or `critical`.
        text: what people read.
        state: how it stands.
        raised_ns: when it was raised last; None if it never was.
        count: how often it was raised.
    """

    name: str
    severity: str
    text: str
    state: AlarmState = AlarmState.NORMAL
    raised_ns: int | None = None
    count: int = 0

    def as_json(self) -> dict[str, object]:
        """Return it as plain values, times in s."""
        return {"name": self.name, "severity": self.severity, "text": self.text,
                "state": self.state.value, "count": self.count,
                "raised_s": None if self.raised_ns is None else self.raised_ns / NS_PER_S}


@dataclass(frozen=True, slots=True)
class Entry:
    """A change of an alarm: when, which, and how it stands then."""

    t_ns: int
    name: str
    state: AlarmState


class Alarms:
    """The table of alarms, one a property at most; its states are tags `alarm.<name>.state`.

    Args:
        alarms: all there can be.
    """

    def __init__(self, alarms: Sequence[Alarm]) -> None:
        self._alarms = list(alarms)
        self._places = {alarm.name.casefold(): n for n, alarm in enumerate(alarms)}
        self.journal: deque[Entry] = deque(maxlen=JOURNAL)
        self.tags = [Tag(f"alarm.{alarm.name}.state", "STRING", comment=alarm.text)
                     for alarm in alarms]
        self._shown: tuple[Value, ...] = tuple(alarm.state.value for alarm in alarms)
        self.acknowledged = self._find_acknowledged()
        """Whether one is acknowledged and not yet cleared."""
        self.changed = False
        """Whether a state changed since `values` was asked last."""

    def __iter__(self) -> Iterator[Alarm]:
        return iter(self._alarms)

    def __getitem__(self, name: str) -> Alarm:
        place = self._places.get(name.casefold())
        if place is None:
            known = [alarm.name for alarm in self._alarms]
            raise AlarmError(f"there is no alarm {name!r}{did_you_mean(name, known)}; there is "
                             f"{', '.join(known) or 'none'}")
        return self._alarms[place]

    def __contains__(self, name: object) -> bool:
        return str(name).casefold() in self._places

    def values(self) -> Sequence[Value]:
        """Return the states, as the values of the tags."""
        self.changed = False
        return self._shown

    def set_state(self, name: str, state: AlarmState, t_ns: int) -> None:
        """Bring an alarm into a state.

        Raises:
            AlarmError: there is no such alarm.
        """
        old = self[name]
        raised = state is AlarmState.RAISED
        self._alarms[self._places[name.casefold()]] = Alarm(
            old.name, old.severity, old.text, state, t_ns if raised else old.raised_ns,
            old.count + raised)
        self.journal.append(Entry(t_ns, old.name, state))
        self._show()

    def _show(self) -> None:
        self._shown = tuple(alarm.state.value for alarm in self._alarms)
        self.acknowledged = self._find_acknowledged()
        self.changed = True

    def _find_acknowledged(self) -> bool:
        return any(alarm.state is AlarmState.ACKNOWLEDGED for alarm in self._alarms)

    def checkpoint(self) -> tuple[Alarm, ...]:
        """Return all alarms as they stand."""
        return tuple(self._alarms)

    def return_to(self, point: Sequence[Alarm]) -> None:
        """Take up how all alarms stood; the journal goes on."""
        self._alarms = list(point)
        self._show()
