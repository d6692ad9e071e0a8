"""What is measured of a task: how long it executes, how late it begins, what it misses.

The percentile is taken from a histogram of fixed, logarithmic classes, so that memory is bounded
however long a run is: durations below 128 ns have a class each, above that every power of two is
cut into 64 classes of equal width. A percentile is told as the upper end of its class: never less
than the exact one, and more by less than 1/64 (1.6 %).
"""

from __future__ import annotations

from dataclasses import dataclass, field

_BITS = 7
"""Leading bits of a duration that its class keeps."""


class Histogram:
    """Counts of durations, by class; at most 3,776 classes hold all 64-bit integers."""

    def __init__(self) -> None:
        self._counts: dict[int, int] = {}
        self._total = 0

    def add(self, duration_ns: int) -> None:
        """Count a duration of 0 ns or more."""
        shift = max(0, duration_ns.bit_length() - _BITS)
        key = shift << _BITS | duration_ns >> shift
        self._counts[key] = self._counts.get(key, 0) + 1
        self._total += 1

    def percentile_ns(self, percent: int) -> int:
        """Return the least class end that so many percent of the durations do not exceed.

        That is the nearest-rank percentile, rounded up to the end of its class; 0 of nothing.
        """
        rank, seen = -(-self._total * percent // 100), 0
        for key in sorted(self._counts):
            seen += self._counts[key]
            if seen >= rank:
                shift, lead = key >> _BITS, key & (1 << _BITS) - 1
                return ((lead + 1) << shift) - 1
        return 0

    def __len__(self) -> int:
        """How many classes are in use."""
        return len(self._counts)


@dataclass(slots=True)
class Durations:
    """Durations of one kind, in ns: the last, extremes, and what mean and percentile need."""

    last_ns: int = 0
    min_ns: int = 0
    max_ns: int = 0
    total_ns: int = 0
    count: int = 0
    histogram: Histogram = field(default_factory=Histogram)

    def add(self, duration_ns: int) -> None:
        """Take one more; what a clock that went back makes negative counts as 0."""
        duration_ns = max(0, duration_ns)
        self.last_ns = duration_ns
        if duration_ns < self.min_ns or not self.count:
            self.min_ns = duration_ns
        if duration_ns > self.max_ns:
            self.max_ns = duration_ns
        self.total_ns += duration_ns
        self.count += 1
        self.histogram.add(duration_ns)

    @property
    def mean_ns(self) -> int:
        """The arithmetic mean, rounded down; 0 of nothing."""
        return self.total_ns // self.count if self.count else 0

    @property
    def p99_ns(self) -> int:
        """The 99th percentile (see the module), at most the maximum."""
        return min(self.histogram.percentile_ns(99), self.max_ns)


@dataclass(slots=True)
class TaskStatistics:
    """What is counted and measured of one task.

    Attributes:
        scans: its runs, with those passed over in virtual time because they change nothing.
        overruns: laps at whose end a later release of it had passed already.
        missed: its releases lost so.
        execution: from the begin to the end of a run; measured in real time only.
        lateness: from its release to the begin of its run; measured in real time only.
    """

    scans: int = 0
    overruns: int = 0
    missed: int = 0
    execution: Durations = field(default_factory=Durations)
    lateness: Durations = field(default_factory=Durations)
