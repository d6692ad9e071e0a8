"""What a formula says of the past, as a deterministic observer that goes along with a run.

The meaning is that of the monitors: values are constant from scan to scan, time is a whole number
of ns, before the start nothing was true. An observer therefore divides the time that a scan's
values stand into pieces in which nothing that it observes changes: `rise(p)` is true in the first
ns of a scan and false after it, `O[0s,1s] p` becomes false 1 s and 1 ns after the last p, wherever
in a scan that is.

Each operation keeps as much of the past as it needs and no more: `O[0,b] q` the age of the latest
q up to b, `O[a,inf) q` that of the first one up to a. So there are finitely many states.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from plcemu.monitor.formula import TRUE, Binary, Formula, Interval, Literal, Unary

ENDLESS = 1 << 62
"""Longer than any time that matters, in ns."""

Memory = tuple[Hashable, ...]
"""What each operation keeps."""


class Piece(NamedTuple):
    """A stretch of time in which nothing that is observed changes.

    Attributes:
        bits: bit n is set if observed formula n is true in it.
        length_ns: how long it is.
        after: what is kept at its end.
    """

    bits: int
    length_ns: int
    after: Memory


class Operation(Protocol):
    """One operation on what is true now and what has been.

    Its arguments are the values of its operands now. `horizon_ns` says for how long the value
    stays if they do, and `after` what is kept once they have stayed so long.
    """

    @property
    def initial(self) -> Hashable: ...
    def value(self, kept: Hashable, args: Sequence[bool]) -> bool: ...
    def horizon_ns(self, kept: Hashable, args: Sequence[bool]) -> int: ...
    def after(self, kept: Hashable, args: Sequence[bool], ns: int) -> Hashable: ...


@dataclass(frozen=True, slots=True)
class Connective:
    """An operation on the present alone."""

    function: Callable[..., bool]
    initial: Hashable = None

    def value(self, kept: Hashable, args: Sequence[bool]) -> bool:
        return self.function(*args)

    def horizon_ns(self, kept: Hashable, args: Sequence[bool]) -> int:
        return ENDLESS

    def after(self, kept: Hashable, args: Sequence[bool], ns: int) -> Hashable:
        return None


@dataclass(frozen=True, slots=True)
class Before:
    """An operation on the value just before this instant; at the start that is what `first` says.

    `first` None stands for the value at the start itself: nothing has changed yet.
    """

    function: Callable[[bool, bool], bool]
    first: bool | None

    @property
    def initial(self) -> Hashable:
        return self.first

    def _value(self, before: Hashable, now: bool) -> bool:
        return self.function(now if before is None else bool(before), now)

    def value(self, kept: Hashable, args: Sequence[bool]) -> bool:
        return self._value(kept, args[0])

    def horizon_ns(self, kept: Hashable, args: Sequence[bool]) -> int:
        now, = args
        return ENDLESS if self._value(kept, now) == self._value(now, now) else 1

    def after(self, kept: Hashable, args: Sequence[bool], ns: int) -> Hashable:
        return args[0]


Ages = tuple[tuple[int, int], ...]
"""Stretches of ages, in ns, the youngest first; both ends belong to them."""


@dataclass(frozen=True, slots=True)
class Since:
    """p S[a,b] q: q was between b and a before now, and p has held since (after q, now included).

    What is kept are the ages of those q after which p has always held, as far as they matter: with
    a = 0 the youngest alone, without b the oldest alone.
    """

    low_ns: int
    high_ns: int | None
    initial: Hashable = ()

    def _ages(self, kept: Hashable, args: Sequence[bool]) -> Ages:
        assert isinstance(kept, tuple)
        return kept if args[0] else ()

    def value(self, kept: Hashable, args: Sequence[bool]) -> bool:
        if args[1] and self.low_ns == 0:
            return True
        high = ENDLESS if self.high_ns is None else self.high_ns
        return any(young <= high and old >= self.low_ns for young, old in self._ages(kept, args))

    def horizon_ns(self, kept: Hashable, args: Sequence[bool]) -> int:
        ends = [self.low_ns] if args[1] else []
        for young, old in self._ages(kept, args):
            ends.append(self.low_ns - old)
            if self.high_ns is not None:
                ends.append(self.high_ns - young + 1)
        return min((ns for ns in ends if ns > 0), default=ENDLESS)

    def after(self, kept: Hashable, args: Sequence[bool], ns: int) -> Hashable:
        ages = [(young + ns, old + ns) for young, old in self._ages(kept, args)]
        if args[1]:
            ages.insert(0, (min(1, ns), ns if args[0] else min(1, ns)))
        if self.high_ns is None:
            return ((min(ages[-1][1], self.low_ns),) * 2,) if ages else ()
        found: list[tuple[int, int]] = []
        for young, old in ages:
            if young > self.high_ns:
                break
            if found and young <= found[-1][1] + 1:
                young, _ = found.pop()
            found.append((young, min(old, self.high_ns)))
        return ((found[0][0],) * 2,) if found and self.low_ns == 0 else tuple(found)


_CONNECTIVES: dict[str, Callable[..., bool]] = {
    "!": lambda p: not p, "&": lambda p, q: p and q, "|": lambda p, q: p or q,
    "->": lambda p, q: not p or q, "<->": lambda p, q: p == q, "xor": lambda p, q: p != q}
_BEFORE: dict[str, Before] = {
    "Y": Before(lambda before, now: before, False),
    "rise": Before(lambda before, now: now and not before, None),
    "fall": Before(lambda before, now: before and not now, None),
    "changed": Before(lambda before, now: before != now, None),
    "previous": Before(lambda before, now: before, None)}
OBSERVED = frozenset(("Y", "S", "O", "H", *_CONNECTIVES, *_BEFORE))
"""The operators that an observer takes."""


class Observer:
    """Observes formulas about the past of a run.

    Args:
        formulas: what is observed.
        inputs: formulas that are given from outside, each with the number of its bit.
    """

    def __init__(self, formulas: Sequence[Formula], inputs: Mapping[Formula, int]) -> None:
        self._steps: list[tuple[Operation, tuple[int, ...]]] = []
        self._number = {formula: n for n, formula in enumerate(inputs)}
        self._bits = tuple(inputs.values())
        self._roots = [self._place(formula) for formula in formulas]
        self.initial: Memory = tuple(op.initial for op, _ in self._steps)
        self.looks_back = any(not isinstance(op, Connective) for op, _ in self._steps)
        """Whether anything of the past is kept at all."""

    def _place(self, formula: Formula) -> int:
        """Return where a formula's value stands in the list of all values."""
        found = self._number.get(formula)
        if found is None:
            operation, operands = _operation(formula)
            args = tuple(map(self._place, operands))
            self._steps.append((operation, args))
            found = self._number[formula] = len(self._bits) + len(self._steps) - 1
        return found

    def pieces(self, kept: Memory, inputs: int, length_ns: int) -> Iterator[Piece]:
        """Divide a stretch of time in which the inputs stand; `kept` is what was kept before.

        Of a stretch without an end, `ENDLESS`, the last piece has none either. One of length 0, a
        scan that takes no time, is one piece.
        """
        some = True
        while some:
            values = [bool(inputs >> bit & 1) for bit in self._bits]
            ns, followed = length_ns, []
            for (operation, places), own in zip(self._steps, kept, strict=True):
                args = [values[place] for place in places]
                values.append(operation.value(own, args))
                ns = min(ns, operation.horizon_ns(own, args))
                followed.append((operation, own, args))
            kept = tuple([operation.after(own, args, ns) for operation, own, args in followed])
            bits = sum(1 << n for n, place in enumerate(self._roots) if values[place])
            yield Piece(bits, ns, kept)
            length_ns -= ns
            some = length_ns > 0


def _operation(formula: Formula) -> tuple[Operation, tuple[Formula, ...]]:
    """Return a formula's outermost operation and its operands."""
    if isinstance(formula, Literal):
        value = bool(formula.value)
        return Connective(lambda: value), ()
    if isinstance(formula, Unary) and formula.op in _BEFORE:
        return _BEFORE[formula.op], (formula.arg,)
    if isinstance(formula, Unary) and formula.op == "O":
        return _since(formula.interval), (TRUE, formula.arg)
    if isinstance(formula, Unary) and formula.op == "H":
        once = Unary("O", Unary("!", formula.arg), formula.interval)
        return Connective(_CONNECTIVES["!"]), (once,)
    if isinstance(formula, Binary) and formula.op == "S":
        return _since(formula.interval), (formula.left, formula.right)
    assert isinstance(formula, (Unary, Binary))
    operands = (formula.arg,) if isinstance(formula, Unary) else (formula.left, formula.right)
    return Connective(_CONNECTIVES[formula.op]), operands


def _since(interval: Interval | None) -> Since:
    interval = interval or Interval()
    return Since(interval.first_ns, interval.last_ns)
