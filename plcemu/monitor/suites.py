"""Monitors over a run whose program is edited: who means the same goes on, others start anew.

An edited program has another tag table. A property goes on in the suite it has been judged in,
which sees the frames under its old table, if its formula is the same and names tags of the same
names, types and units. Every other property starts with the first frame of the edited program.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace

from plcemu.base.tags import Tag, TagTable
from plcemu.base.trace import Frame
from plcemu.monitor.parse import Property
from plcemu.monitor.suite import Suite
from plcemu.monitor.verdict import Result


@dataclass(slots=True)
class _Member:
    """A suite with its tag table; `route` maps the run's tag indices to its own, None if equal."""

    suite: Suite
    tags: TagTable
    names: list[str]
    route: dict[int, int] | None = None

    def reroute(self, tags: TagTable) -> None:
        by_name = {tag.name.casefold(): n for n, tag in enumerate(tags)}
        self.route = {by_name[self.tags[n].name.casefold()]: n for n in self.suite.tags_used()}


@dataclass(frozen=True, slots=True)
class Succession:
    """What becomes of the properties when the program is edited.

    Attributes:
        properties: of the edited program.
        restarted: names of those that start anew.
        fresh: judges these.
        tags: the new table.
    """

    properties: tuple[Property, ...]
    restarted: tuple[str, ...]
    fresh: Suite
    tags: TagTable


class Suites:
    """Looks like a `Suite`; may change its tag table while it runs.

    Raises:
        CompileError: a property does not fit the tags.
    """

    def __init__(self, properties: Sequence[Property], tags: TagTable) -> None:
        self.properties = tuple(properties)
        self.tags = tags
        names = [p.name for p in properties]
        self._members = [_Member(Suite(properties, tags), tags, names)]

    # ------------------------------------------------------------ an edited program

    def plan(self, properties: Sequence[Property], tags: TagTable) -> Succession:
        """Find out what would become of the properties; nothing changes yet.

        Raises:
            CompileError: a property does not fit the new tags.
        """
        fresh = Suite(properties, tags)
        old = {p.name: p for p in self.properties}
        restarted = tuple(p.name for p in properties
                          if p.name not in old or old[p.name].formula != p.formula
                          or self._meaning(p.name) != _used(fresh, tags, p.name))
        fresh.keep_only(restarted)
        return Succession(tuple(properties), restarted, fresh, tags)

    def follow(self, plan: Succession) -> None:
        """Go on as planned; the next frame must hold every tag."""
        going_on = {p.name for p in plan.properties} - set(plan.restarted)
        for member in self._members:
            member.names = [name for name in member.names if name in going_on]
            member.suite.keep_only(member.names)
        members = [member for member in self._members if member.names]
        for member in members:
            member.reroute(plan.tags)
        if plan.restarted or not members:
            members.append(_Member(plan.fresh, plan.tags, list(plan.restarted)))
        self._members, self.properties, self.tags = members, plan.properties, plan.tags

    def restart(self, name: str, frame: Frame) -> None:
        """Judge a property anew, from a frame on that holds every tag; without it, do nothing."""
        found = next((p for p in self.properties if p.name == name), None)
        if found is None:  # an edited program has another list
            return
        for member in self._members:
            if name in member.names:
                member.names = [each for each in member.names if each != name]
                member.suite.keep_only(member.names)
        fresh = _Member(Suite([found], self.tags), self.tags, [name])
        fresh.suite.observe(frame)
        self._members = [*(m for m in self._members if m.names), fresh]

    @property
    def reads(self) -> frozenset[int]:
        """The indices of the tags that the properties read."""
        names = {member.tags[n].name for member in self._members
                 for n in member.suite.tags_used()}
        return frozenset(self.tags.find(name) for name in names)

    def _meaning(self, name: str) -> set[Tag]:
        member = next(m for m in self._members if name in m.names)
        return _used(member.suite, member.tags, name)

    # ------------------------------------------------------------ as a suite

    def observe(self, frame: Frame) -> None:
        """Take one frame."""
        members = self._members
        if len(members) == 1 and members[0].route is None:
            members[0].suite.observe(frame)
            return
        for member in members:
            route = member.route
            if route is None:
                member.suite.observe(frame)
                continue
            changes = sorted((route[n], value) for n, value in frame.changes if n in route)
            news = tuple(c for c in changes if member.suite.value(c[0]) != c[1])
            member.suite.observe(Frame(frame.t_ns, frame.scan, news))

    def advance(self, t_ns: int) -> None:
        """Take it that nothing changed since the last frame up to and with the instant `t_ns`."""
        for member in self._members:
            member.suite.advance(t_ns)

    def finish(self, t_ns: int) -> list[Result]:
        """Cut the run after the instant `t_ns`, and return how every property stands."""
        self.advance(t_ns)
        return self.results()

    def copy(self) -> Suites:
        """Return independent monitors in the same state."""
        twin = copy.copy(self)
        twin._members = [replace(member, suite=member.suite.copy()) for member in self._members]
        return twin

    def next_deadline_ns(self) -> int | None:
        """Return the first instant at which a verdict falls if nothing changes, in ns."""
        first = None
        for member in self._members:
            t_ns = member.suite.next_deadline_ns()
            if t_ns is not None and (first is None or t_ns < first):
                first = t_ns
        return first

    @property
    def undecided(self) -> int:
        """How many properties have no final verdict yet."""
        members = self._members
        if len(members) == 1:
            return members[0].suite.undecided
        return sum(member.suite.undecided for member in members)

    def verdicts(self) -> list[str]:
        """Return the verdicts alone, in the order the properties were given."""
        if len(self._members) == 1:
            return self._members[0].suite.verdicts()
        found = {name: verdict for m in self._members
                 for name, verdict in zip(m.names, m.suite.verdicts(), strict=True)}
        return [found[p.name] for p in self.properties]

    def results(self) -> list[Result]:
        """Return how every property stands now, in the order they were given."""
        found = {result.name: result for m in self._members for result in m.suite.results()}
        return [found[p.name] for p in self.properties]


def _used(suite: Suite, tags: TagTable, name: str) -> set[Tag]:
    """Return the tags that a property of a suite names, with what its meaning rests on."""
    return {Tag(tag.name.casefold(), tag.type, tag.unit)
            for tag in (tags[n] for n in suite.tags_used(name))}
