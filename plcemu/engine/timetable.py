"""The releases of several tasks together: what of a resource is due, and when."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Protocol

from plcemu.engine.releases import Releases

_BY_SHARES = 8
"""Progressions up to which releases are counted in closed form, in at most 2^8 steps."""
_AT_ONCE = 1 << 16
"""Releases that are counted one by one at a time: a bound on memory."""
_FEW = 32
"""Releases that are counted sooner one by one."""


class Schedule(Protocol):
    """When something is released, with or without jitter."""

    def is_due(self, t_ns: int) -> bool:
        """Whether an instant is a release."""

    def first(self, not_before_ns: int) -> int:
        """Return the first release not before an instant."""

    def last(self, before_ns: int) -> int:
        """Return the last release before an instant; -1 if there is none."""

    def count(self, first_ns: int, before_ns: int) -> int:
        """Return how many releases lie in [first, before)."""

    def within(self, first_ns: int, before_ns: int) -> Collection[int]:
        """Return the releases in [first, before)."""


def together(all_of: Iterable[Schedule]) -> Schedule:
    """Return several schedules as one; an instant at which two are released counts once.

    What releases nothing of its own is left out, so that of tasks whose intervals are multiples of
    the fastest one's only that one remains.
    """
    several: list[Schedule] = []
    for each in sorted(dict.fromkeys(all_of), key=_interval):
        if not any(isinstance(each, Releases) and isinstance(other, Releases)
                   and other.holds(each) for other in several):
            several.append(each)
    return several[0] if len(several) == 1 else Timetable(several)


def _interval(schedule: Schedule) -> int:
    return schedule.step if isinstance(schedule, Releases) else 0


class Timetable:
    """Several schedules of which none covers another."""

    def __init__(self, several: Iterable[Schedule]) -> None:
        self._several = tuple(several)
        self._regular = [each for each in self._several if isinstance(each, Releases)]
        self._in_closed_form = len(self._regular) == len(self._several) <= _BY_SHARES

    def is_due(self, t_ns: int) -> bool:
        """Whether an instant is a release of any."""
        return any(each.is_due(t_ns) for each in self._several)

    def first(self, not_before_ns: int) -> int:
        """Return the first release of any not before an instant."""
        return min([each.first(not_before_ns) for each in self._several])

    def last(self, before_ns: int) -> int:
        """Return the last release of any before an instant; -1 if there is none."""
        return max([each.last(before_ns) for each in self._several])

    def count(self, first_ns: int, before_ns: int) -> int:
        """Return how many instants in [first, before) are releases of at least one.

        With jitter, or with more than `_BY_SHARES` progressions, it takes some 0.1 us a release.
        """
        releases = sum([each.count(first_ns, before_ns) for each in self._several])
        if releases <= _FEW:
            return len(self.within(first_ns, before_ns))
        if self._in_closed_form:
            return count_any(self._regular, first_ns, before_ns)
        stretch = max(1, (before_ns - first_ns) * _AT_ONCE // releases)
        return sum(len(self.within(begin, min(begin + stretch, before_ns)))
                   for begin in range(first_ns, before_ns, stretch))

    def within(self, first_ns: int, before_ns: int) -> set[int]:
        """Return the instants in [first, before) that are releases of at least one."""
        return set().union(*(each.within(first_ns, before_ns) for each in self._several))


def count_any(all_of: Iterable[Releases], first_ns: int, before_ns: int) -> int:
    """Return how many instants in [first, before) are in at least one of several progressions.

    Inclusion and exclusion: each progression counts without what it shares with those before it.
    What shares nothing in the stretch is left out. Of n progressions it takes up to 2^n steps.
    """
    counted: list[Releases] = []
    total = 0
    for each in dict.fromkeys(all_of):
        own = each.count(first_ns, before_ns)
        if own:
            shared = [both for other in counted if (both := each.meet(other)) is not None
                      and both.count(first_ns, before_ns)]
            if each not in shared:
                total += own - count_any(shared, first_ns, before_ns)
                counted.append(each)
    return total
