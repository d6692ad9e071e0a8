"""When tasks are released: arithmetic progressions, counted in closed form."""

from __future__ import annotations

from dataclasses import dataclass
from math import gcd


@dataclass(frozen=True, slots=True)
class Releases:
    """The instants start + k · step with k = 0, 1, 2, ..., in ns."""

    start: int
    step: int

    def is_due(self, t_ns: int) -> bool:
        """Whether an instant is one of them."""
        return t_ns >= self.start and (t_ns - self.start) % self.step == 0

    def first(self, not_before_ns: int) -> int:
        """Return the first one not before an instant."""
        start, step = self.start, self.step
        return start - (start - not_before_ns) // step * step if not_before_ns > start else start

    def last(self, before_ns: int) -> int:
        """Return the last one before an instant; -1 if there is none."""
        since = before_ns - 1 - self.start
        return self.start + since // self.step * self.step if since >= 0 else -1

    def count(self, first_ns: int, before_ns: int) -> int:
        """Return how many lie in [first, before)."""
        start, step = self.start, self.step
        first, end = -((start - first_ns) // step), -((start - before_ns) // step)
        return max(0, end - max(0, first))

    def within(self, first_ns: int, before_ns: int) -> range:
        """Return those in [first, before)."""
        return range(self.first(first_ns), before_ns, self.step)

    def holds(self, other: Releases) -> bool:
        """Whether all instants of another progression are also in this one."""
        return other.step % self.step == 0 and self.is_due(other.start)

    def meet(self, other: Releases) -> Releases | None:
        """Return the instants in both, by the Chinese remainder theorem; None if there are none."""
        common = gcd(self.step, other.step)
        apart = other.start - self.start
        if apart % common:
            return None
        own, others = self.step // common, other.step // common
        one = self.start + apart // common * pow(own, -1, others) % others * self.step
        both = self.step * others
        return Releases(Releases(one % both, both).first(max(self.start, other.start)), both)
