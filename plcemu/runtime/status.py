"""The PLC's own values as tags: state and fault, tasks, what the cycle counts, verdicts.

Each class is a source of tags for the cycle. What changes in every lap is not shown in every frame:
in real time the statistics of tasks are shown anew once in `SHOWN_EVERY_NS`, in virtual time, where
nothing is measured, not at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Protocol

from plcemu.base.tags import Tag
from plcemu.base.types import Value
from plcemu.engine.resource import Resource
from plcemu.engine.statistics import TaskStatistics
from plcemu.monitor.parse import Property
from plcemu.monitor.suites import Suites

SHOWN_EVERY_NS = 1_000_000_000
"""The least time between two frames that show the statistics of tasks anew, in ns."""


class Source(Protocol):
    """Tags whose values do not stand in memory."""

    @property
    def tags(self) -> Sequence[Tag]:
        """The tags, in a fixed order."""

    def values(self) -> Sequence[Value | None]:
        """Their values as frames show them; another sequence whenever one has changed.

        None is a value that is not known (quality *bad*).
        """


class StateTags:
    """The state of a resource and why it is in FAULT."""

    def __init__(self, resource: Resource) -> None:
        self.tags = [Tag("resource.state", "STRING", comment="RUN, STOP or FAULT"),
                     Tag("resource.fault", "STRING", comment="why it is in FAULT, or empty")]
        self._resource = resource
        self._shown: tuple[Value, ...] = ()
        self._known: tuple[object, object] = (None, None)

    def values(self) -> Sequence[Value]:
        """Return state and fault."""
        known = (self._resource.state, self._resource.fault)
        if known != self._known:
            self._known = known
            self._shown = (known[0].value, str(known[1] or ""))
        return self._shown


@dataclass(slots=True)
class CycleCounters:
    """What the cycle counts.

    Attributes:
        laps: laps executed.
        skipped: releases passed over because nothing could change (virtual time).
        overruns: laps that ended after the next release.
        missed: releases lost to overruns.
        late_ns: how long after its release the last lap began.
        max_late_ns: the largest of these.
        last_lap_ns: how long the last lap took, by the clock.
        max_lap_ns: the largest of these.
    """

    laps: int = 0
    skipped: int = 0
    overruns: int = 0
    missed: int = 0
    late_ns: int = 0
    max_late_ns: int = 0
    last_lap_ns: int = 0
    max_lap_ns: int = 0
    tags: list[Tag] = field(default_factory=lambda: [
        Tag("task.overruns", "ULINT", comment="laps that ended after the next release"),
        Tag("task.missed", "ULINT", comment="releases lost to overruns")])

    shown: tuple[int, ...] = (0, 0)
    """The values of the tags as they were told last."""

    def values(self) -> Sequence[Value]:
        """Return the values of the tags."""
        if self.shown != (self.overruns, self.missed):
            self.shown = (self.overruns, self.missed)
        return self.shown

    def numbers(self) -> dict[str, int]:
        """Return everything counted, by attribute."""
        return {f.name: getattr(self, f.name) for f in fields(self)
                if f.name not in ("tags", "shown")}


_COUNTS = {"scans": "runs of the task", "overruns": "laps that made it miss releases",
           "missed": "its releases lost to overruns"}
_TIMES = {"execution": "from the begin to the end of a run",
          "lateness": "from a release to the begin of its run"}
_KINDS = {"last": "the last one", "min": "the shortest", "max": "the longest",
          "mean": "the mean", "p99": "the 99th percentile, rounded up by at most 1.6 %"}


class TaskTags:
    """The statistics of a resource's tasks: `task.fast.overruns`, `task.fast.lateness_p99`, ..."""

    def __init__(self, resource: Resource) -> None:
        self._resource = resource
        self.tags = [tag for task in resource.tasks for tag in _task_tags(task.name)]
        self._shown: Sequence[Value] = [0] * len(self.tags)
        self._show_at_ns = 0

    def values(self) -> Sequence[Value]:
        """Return what was shown last."""
        return self._shown

    def present(self) -> Sequence[Value]:
        """Return the values of this instant."""
        return [value for each in self._resource.statistics for value in _task_values(each)]

    def show(self, t_ns: int) -> None:
        """Show the values of an instant, if the last ones are old enough."""
        if t_ns >= self._show_at_ns:
            self._show_at_ns = t_ns + SHOWN_EVERY_NS
            self._shown = self.present()


def _task_tags(name: str) -> list[Tag]:
    counts = [Tag(f"task.{name}.{what}", "ULINT", comment=text) for what, text in _COUNTS.items()]
    return counts + [Tag(f"task.{name}.{what}_{kind}", "TIME", "ns", comment=f"{text}, {of}")
                     for what, text in _TIMES.items() for kind, of in _KINDS.items()]


def _task_values(each: TaskStatistics) -> list[Value]:
    values: list[Value] = [each.scans, each.overruns, each.missed]
    for times in (each.execution, each.lateness):
        values += [times.last_ns, times.min_ns, times.max_ns, times.mean_ns, times.p99_ns]
    return values


class VerdictTags:
    """The monitors' verdicts."""

    def __init__(self, properties: Sequence[Property]) -> None:
        self.tags = [Tag(f"monitor.{p.name}.verdict", "STRING", comment=p.description)
                     for p in properties]
        self.suite: Suites | None = None

    def values(self) -> Sequence[Value]:
        """Return the verdicts."""
        if self.suite is None:
            return ["presumably satisfied"] * len(self.tags)
        return self.suite.verdicts()
