"""Signals over time that are known throughout, and the operations that all of temporal logic needs.

A signal is a list of (start, value) pairs in order of start, neighbours of different value; each
holds until the next, the last one for ever. Time is a whole number of ns since the first frame;
before 0 nothing was true. Values are Kleene's: `NO`, `UNSURE` (it hinges on a value that was not
known), `YES`.

Every operator of the language is one of five operations, because on whole ns

    F[a,b] p = window(p, a, b)          O[a,b] p = window(p, -b, -a)       Y p = window(p, -1, -1)
    p U[a,b] q = G[0,a-1] p & F[a,a] ((p U q) & F[0,b-a] q)                and so for S,

and G, H, W and R are their duals. With the expansions of the source below they also agree in
three values, so a formula is decided as early as its parts allow. Here they say how a formula
stands where a run is cut; `plcemu.monitor.network` works them out while a run goes on.
"""

from __future__ import annotations

from collections.abc import Callable

Signal = list[tuple[int, int]]
NO, UNSURE, YES = 0, 1, 2
BEYOND = 1 << 80
"""Later than every instant."""


def put(signal: Signal, start: int, value: int) -> None:
    """Append a stretch, replacing what was said from `start` on, and join equal neighbours."""
    while signal and signal[-1][0] >= start:
        signal.pop()
    if not signal or signal[-1][1] != value:
        signal.append((start, value))


def since_start(signal: Signal, start: int) -> Signal:
    """Return the signal from an instant on."""
    if signal[0][0] >= start:
        return signal
    tail: Signal = []
    for begin, value in signal:
        put(tail, max(begin, start), value)
    return tail


def until_end(signal: Signal, end: int, after: int) -> Signal:
    """Return the signal up to and with the instant `end`, and the value `after` beyond it."""
    head = [stretch for stretch in signal if stretch[0] <= end]
    put(head, end + 1, after)
    return head


def negation(signal: Signal) -> Signal:
    """Return not p."""
    return [(start, YES - value) for start, value in signal]


def combined(left: Signal, right: Signal, choose: Callable[[int, int], int]) -> Signal:
    """Return p and q (by `min`) or p or q (by `max`); both signals start at the same instant."""
    result: Signal = []
    for start, p, q in pairs(left, right):
        put(result, start, choose(p, q))
    return result


def pairs(left: Signal, right: Signal) -> list[tuple[int, int, int]]:
    """Return (start, p, q) for each stretch in which neither of two signals changes."""
    result, i, j = [], 0, 0
    start = left[0][0]
    while start < BEYOND:
        result.append((start, left[i][1], right[j][1]))
        next_left = left[i + 1][0] if i + 1 < len(left) else BEYOND
        next_right = right[j + 1][0] if j + 1 < len(right) else BEYOND
        i, j = i + (next_left <= next_right), j + (next_right <= next_left)
        start = min(next_left, next_right)
    return result


def window(child: Signal, low: int, high: int, start: int) -> Signal:
    """Return, from `start` on, whether p holds somewhere in [t + low, t + high].

    A stretch of YES reaches `high` before it and ends `low` before its end; a stretch of NO counts
    where the whole window lies in it. The child is known from `start + low` on, or from 0.
    """
    found: list[tuple[int, int, int]] = []
    for k, (begin, value) in enumerate(child):
        end = child[k + 1][0] - 1 if k + 1 < len(child) else BEYOND
        first = begin if begin > 0 else -BEYOND
        if value == YES:
            found.append((begin - high, end - low, YES))
        elif value == NO and first - low <= end - high:
            found.append((first - low, end - high, NO))
    if child[0][0] == 0 and child[0][1] != NO and low < 0:
        found.append((-BEYOND, -1 - high, NO))
    return _painted(found, start)


def _painted(found: list[tuple[int, int, int]], start: int) -> Signal:
    """Lay stretches over a signal that is UNSURE everywhere; they agree where they overlap."""
    found.sort()
    result: Signal = [(start, UNSURE)]
    free = start
    for first, last, value in found:
        first = max(first, free)
        if last >= first:
            put(result, first, value)
            free = last + 1
            if last < BEYOND // 2:
                put(result, free, UNSURE)
    return result


def until(left: Signal, right: Signal) -> Signal:
    """Return p U q without a bound: q comes, and p holds until then."""
    result: Signal = []
    ahead = NO  # a q that never comes makes it false
    for start, p, q in reversed(pairs(left, right)):
        ahead = max(q, min(p, ahead))
        if result and result[-1][1] == ahead:
            result.pop()
        result.append((start, ahead))
    result.reverse()
    return result


def since(left: Signal, right: Signal, before: int) -> Signal:
    """Return p S q without a bound: q has been, and p holds since; `before` is its last value."""
    result: Signal = []
    for start, p, q in pairs(left, right):
        before = max(q, min(p, before))
        put(result, start, before)
    return result
