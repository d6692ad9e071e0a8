"""Online change: an edited program takes over between two scans, and what it still has lives on.

Everything that can fail or takes time happens beforehand, in any thread (`prepare`); the change
itself (`Change.apply`) only copies bytes. It keeps every variable, timer and step whose full name
and type exist in both programs, all clients' connections, the image, and forces on what is kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from plcemu.base.tags import TagTable
from plcemu.engine.resource import Resource
from plcemu.io.exchange import Exchange, Extent
from plcemu.ir.program import Program
from plcemu.ir.shape import Match, charts, match
from plcemu.monitor.parse import Property
from plcemu.runtime.cycle import Cycle, Replacement, Stimulus


@dataclass(frozen=True, slots=True)
class ChangeReport:
    """What an online change did; every list holds full names.

    Attributes:
        kept: what has the value that it had.
        added: what began at its initial value.
        dropped: what is no more, or of another type.
        left_steps: steps that were active and are no more.
        restarted_charts: instances whose chart had no step left and takes its initial situation.
        ended_forces: what is no longer forced, because it is no more.
        restarted_properties: properties that are judged anew, since they mean something else.
        is_recorded_anew: whether the recording began anew, since the tags are others.
    """

    kept: tuple[str, ...]
    added: tuple[str, ...]
    dropped: tuple[str, ...]
    left_steps: tuple[str, ...] = ()
    restarted_charts: tuple[str, ...] = ()
    ended_forces: tuple[str, ...] = ()
    restarted_properties: tuple[str, ...] = ()
    is_recorded_anew: bool = False

    def as_json(self) -> dict[str, Any]:
        """Return it as plain values."""
        return {name: list(value) if isinstance(value, tuple) else value
                for name in self.__dataclass_fields__ for value in [getattr(self, name)]}

    def __str__(self) -> str:
        counts = [f"{len(self.kept)} kept", f"{len(self.added)} added",
                  f"{len(self.dropped)} dropped"]
        told = (("dropped", self.dropped), ("active steps that are gone", self.left_steps),
                ("charts at their initial situation", self.restarted_charts),
                ("forces that ended", self.ended_forces),
                ("properties judged anew", self.restarted_properties))
        return "; ".join([", ".join(counts), *(f"{what}: {', '.join(which[:20])}" +
                                               (" ..." if len(which) > 20 else "")
                                               for what, which in told if which)])


class Change:
    """An edited program, ready to take over.

    Args:
        cycle: which runs the program so far.
        resource: with the edited program, as made.
        properties: to be judged from now on.
        player: of the scenario under way, for the edited program; None if there is none.

    Raises:
        CompileError: a property does not fit the edited program.
        PlcemuError: two tags have one name.
    """

    def __init__(self, cycle: Cycle, resource: Resource, properties: Sequence[Property],
                 player: Stimulus | None = None) -> None:
        self.resource = resource
        self.match: Match = match(cycle.resource.program.layout.variables,
                                  resource.program.layout.variables)
        self._cycle = cycle
        self._player = player
        self._old = cycle.resource
        self._plan: Replacement = cycle.plan(resource, properties)

    @property
    def is_stale(self) -> bool:
        """Whether another change came first, so that this one must be prepared anew."""
        return self._cycle.resource is not self._old

    def apply(self) -> ChangeReport:
        """Take over, between two scans.

        Writes that wait are latched into the old memory first, so that they count for the variables
        that they meant.
        """
        cycle, old, new = self._cycle, self._old, self.resource
        exchange = cycle.exchange
        exchange.update_inputs()
        exchange.update_outputs()
        same_tags = list(cycle.tags) == list(self._plan.succession.tags)
        old_charts = charts(old.program.layout.variables)
        left = tuple(name for chart in old_charts for name, flag in chart.steps
                     if old.memory.block[flag] and self.match.place(flag, 1) is None)
        self._fill(exchange)
        restarted = self._restart_charts()
        offsets = exchange.rebind(new.memory.block, extents_of(new.program), self.match.place)
        new.succeed(old)
        cycle.replace(self._plan)
        if self._player is not None and cycle.player is not None:
            self._player.played = cycle.player.played
            cycle.player = self._player
        exchange.update_outputs()
        found = self.match
        return ChangeReport(
            tuple(found.kept), tuple(found.added), tuple(found.dropped), left, restarted,
            tuple(_names_at(old, offsets)), self._plan.succession.restarted, not same_tags)

    def _fill(self, exchange: Exchange) -> None:
        """Give the new memory the image, initial values for what is new, and then what is kept."""
        layout, block = self.resource.program.layout, self.resource.memory.block
        for extent in extents_of(self.resource.program):
            part = extent.image_slice
            image = exchange.published(extent.area, part.start, part.stop - part.start)
            block[extent.memory_slice] = extent.to_memory(image)
        for variable in layout.variables:
            end = variable.offset + variable.size
            block[variable.offset:end] = layout.initial[variable.offset:end]
        self.match.carry(bytes(self._old.memory.block), block)

    def _restart_charts(self) -> tuple[str, ...]:
        """Let a chart that has run and has no active step left begin anew; return such charts."""
        block = self.resource.memory.block
        restarted = []
        for chart in charts(self.resource.program.layout.variables):
            if block[chart.started] and not any(block[flag] for _, flag in chart.steps):
                block[chart.started] = 0
                restarted.append(chart.name)
        return tuple(restarted)


def extents_of(program: Program) -> list[Extent]:
    """Return the stretches of the image that a program uses."""
    return [Extent(e.area, e.first, e.count, e.offset) for e in program.layout.extents]


def make_exchange(resource: Resource) -> Exchange:
    """Return the exchange over a resource's memory."""
    return Exchange(resource.memory.block, extents_of(resource.program))


def _names_at(resource: Resource, offsets: Sequence[int]) -> list[str]:
    """Return the names of the tags at places in memory."""
    tags: TagTable = resource.memory.tags
    by_offset = {resource.memory.place(n)[0]: tag.name for n, tag in enumerate(tags)}
    return [by_offset.get(offset, f"byte {offset}") for offset in offsets]
