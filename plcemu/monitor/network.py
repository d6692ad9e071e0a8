"""Any formula as a network of signal operations that is kept up to date as time passes.

Each node keeps its signal from the first instant that is still open on; what is settled has been
absorbed by the node above and is forgotten. So memory is bounded by the changes inside the
windows that are still open, and `LIMIT` bounds it where a formula keeps windows open for ever,
as `F (p & G q)` does.
"""

from __future__ import annotations

from collections.abc import Callable

from plcemu.base.errors import LimitError
from plcemu.monitor.bind import State
from plcemu.monitor.formula import TRUE, Binary, Formula, Interval, Literal, Unary, is_state
from plcemu.monitor.signals import (
    BEYOND,
    NO,
    OPEN,
    YES,
    Signal,
    conjunction,
    negation,
    pairs,
    put,
    since,
    since_start,
    until,
    until_end,
    value_at,
    window,
)

LIMIT = 100_000
"""The largest number of stretches that a node keeps."""


class Node:
    """One operation; `settled` is the first instant at which its own value is still open."""

    reach_ns = 0
    """How far from an instant, in ns, the operands are looked at."""

    def __init__(self, *args: Node) -> None:
        self.args = args
        self.out: Signal = [(0, OPEN)]
        self.settled = 0

    def compute(self, args: list[Signal]) -> Signal:
        """Return the signal from `settled` on."""
        raise NotImplementedError

    def needs_from(self) -> int:
        """Return the first instant at which the operands are still asked for."""
        return self.settled

    def known(self, end: int) -> Signal:
        """Return the signal as far as it is known once the instant `end` has been seen."""
        if self.settled >= BEYOND:
            return self.out
        fresh = self.compute([arg.known(end) for arg in self.args])
        return self._joined(fresh)

    def commit(self, end: int) -> None:
        """Settle what is known once the instant `end` has been seen."""
        if self.settled < BEYOND:
            for arg in self.args:
                arg.commit(end)
            self.keep(self._joined(self.compute([arg.out for arg in self.args])))

    def keep(self, signal: Signal) -> None:
        """Make a signal the node's own."""
        if len(signal) > LIMIT:
            raise LimitError(f"more than {LIMIT} changes wait for a decision; bound the formula's "
                             "operators by intervals")
        self.out = signal
        self.settled = next((s for s, v in signal if v == OPEN and s >= self.settled), BEYOND)

    def finite(self, end: int) -> Signal:
        """Return the signal if the run ended with the instant `end`: what is not seen is not."""
        args = [until_end(arg.finite(end), end, NO) for arg in self.args]
        if self.settled >= BEYOND:
            return self.out
        filled: Signal = []
        for start, known, guess in pairs(since_start(self.out, self.settled), self.compute(args)):
            put(filled, start, guess if known == OPEN else known)
        return self._joined(filled)

    def forget(self, need: int) -> None:
        """Drop what ends before the instant `need`, here and below."""
        first, out = 0, self.out
        while first + 1 < len(out) and out[first + 1][0] <= need:
            first += 1
        if first:
            self.out = out[first:]
        below = self.needs_from()
        for arg in self.args:
            arg.forget(below)

    def _joined(self, fresh: Signal) -> Signal:
        head = [stretch for stretch in self.out if stretch[0] < self.settled]
        put(head, *fresh[0])
        return head + fresh[1:]


class Constant(Node):
    """TRUE or FALSE."""

    def __init__(self, value: int) -> None:
        super().__init__()
        self.out, self.settled = [(0, value)], BEYOND


class Atom(Node):
    """A state formula; its signal reaches beyond what has been seen, as if nothing changed."""

    def __init__(self, state: State) -> None:
        super().__init__()
        self.state = state
        self.reach_ns = int(state.pulsed)
        self.seen: Signal = []

    def step(self, t: int, at: bool, after: bool) -> None:
        """Take the value at an instant and the value from the next ns on."""
        put(self.seen, t, YES if at else NO)
        if at is not after:
            put(self.seen, t + 1, YES if after else NO)

    def known(self, end: int) -> Signal:
        return until_end(self.seen, end, OPEN)

    def commit(self, end: int) -> None:
        self.keep(until_end(self.seen, end, OPEN))

    def finite(self, end: int) -> Signal:
        return until_end(self.seen, end, NO)

    def forget(self, need: int) -> None:
        while len(self.seen) > 1 and self.seen[1][0] <= need:
            del self.seen[0]


class Not(Node):
    """Not p."""

    def compute(self, args: list[Signal]) -> Signal:
        return negation(since_start(args[0], self.settled))


class And(Node):
    """p and q."""

    def compute(self, args: list[Signal]) -> Signal:
        return conjunction(*(since_start(arg, self.settled) for arg in args))


class Window(Node):
    """p somewhere between two instants, both relative to now, in ns."""

    def __init__(self, arg: Node, low_ns: int, high_ns: int) -> None:
        super().__init__(arg)
        self.low_ns, self.high_ns = low_ns, high_ns
        self.reach_ns = max(abs(low_ns), abs(high_ns)) + 1

    def compute(self, args: list[Signal]) -> Signal:
        return window(args[0], self.low_ns, self.high_ns, self.settled)

    def needs_from(self) -> int:
        return max(0, self.settled + self.low_ns)


class Until(Node):
    """p until q, without a bound."""

    def compute(self, args: list[Signal]) -> Signal:
        return until(*(since_start(arg, self.settled) for arg in args))


class Since(Node):
    """p since q, without a bound."""

    def compute(self, args: list[Signal]) -> Signal:
        before = value_at(self.out, self.settled - 1) if self.settled else NO
        left, right = (since_start(arg, self.settled) for arg in args)
        return since(left, right, before)

    def forget(self, need: int) -> None:
        super().forget(min(need, self.settled - 1))


class Builder:
    """Turns a linear formula into nodes; every tag-only part becomes one atom."""

    def __init__(self, compile_state: Callable[[Formula], State]) -> None:
        self.compile_state = compile_state
        self.atoms: list[Atom] = []
        self.nodes: dict[int, Node] = {}

    def build(self, formula: Formula) -> Node:
        """Return the node of a formula, and remember it under the formula's identity."""
        node = self._build(formula)
        self.nodes[id(formula)] = node
        return node

    def _build(self, formula: Formula) -> Node:
        if isinstance(formula, Literal):
            return Constant(YES if formula.value else NO)
        if is_state(formula):
            atom = Atom(self.compile_state(formula))
            self.atoms.append(atom)
            return atom
        if isinstance(formula, Unary):
            return _UNARY[formula.op](self, formula)
        assert isinstance(formula, Binary)
        return _BINARY[formula.op](self, formula)


def _interval(formula: Unary | Binary) -> tuple[int, int | None]:
    interval = formula.interval or Interval()
    return interval.first_ns, interval.last_ns


def _eventually(arg: Node, low: int, high: int | None) -> Node:
    if high is not None:
        return Window(arg, low, high)
    ahead = Until(Constant(YES), arg)
    return Window(ahead, low, low) if low else ahead


def _once(arg: Node, low: int, high: int | None) -> Node:
    if high is not None:
        return Window(arg, -high, -low)
    behind = Since(Constant(YES), arg)
    return Window(behind, -low, -low) if low else behind


def _or(left: Node, right: Node) -> Node:
    return Not(And(Not(left), Not(right)))


def _bounded(make: Callable[[], tuple[Node, Node]], formula: Binary, joined: type[Node],
             somewhere: Callable[[Node, int, int | None], Node]) -> Node:
    """Return p U[a,b] q or p S[a,b] q from the unbounded operator; `make` gives fresh operands."""
    low, high = _interval(formula)
    node: Node = joined(*make())
    if high is not None:
        node = And(node, somewhere(make()[1], 0, high - low))
    if low:
        throughout = Not(somewhere(Not(make()[0]), 0, low - 1))
        node = And(throughout, somewhere(node, low, low))
    return node


def _until(b: Builder, f: Binary) -> Node:
    return _bounded(lambda: (b.build(f.left), b.build(f.right)), f, Until, _eventually)


def _since(b: Builder, f: Binary) -> Node:
    return _bounded(lambda: (b.build(f.left), b.build(f.right)), f, Since, _once)


def _release(b: Builder, f: Binary) -> Node:
    return Not(_bounded(lambda: (Not(b.build(f.left)), Not(b.build(f.right))), f, Until,
                        _eventually))


def _weak_until(b: Builder, f: Binary) -> Node:
    throughout = Not(_eventually(Not(b.build(f.left)), 0, _interval(f)[1]))
    return _or(_until(b, f), throughout)


def _implies(b: Builder, f: Binary) -> Node:
    return Not(And(b.build(f.left), Not(b.build(f.right))))


def _equivalent(b: Builder, f: Binary) -> Node:
    return And(_implies(b, f), Not(And(b.build(f.right), Not(b.build(f.left)))))


_UNARY: dict[str, Callable[[Builder, Unary], Node]] = {
    "!": lambda b, f: Not(b.build(f.arg)),
    "F": lambda b, f: _eventually(b.build(f.arg), *_interval(f)),
    "G": lambda b, f: Not(_eventually(Not(b.build(f.arg)), *_interval(f))),
    "O": lambda b, f: _once(b.build(f.arg), *_interval(f)),
    "H": lambda b, f: Not(_once(Not(b.build(f.arg)), *_interval(f))),
    "Y": lambda b, f: Window(b.build(f.arg), -1, -1),
}
_BINARY: dict[str, Callable[[Builder, Binary], Node]] = {
    "&": lambda b, f: And(b.build(f.left), b.build(f.right)),
    "|": lambda b, f: _or(b.build(f.left), b.build(f.right)),
    "->": _implies,
    "<->": _equivalent,
    "U": _until,
    "W": _weak_until,
    "R": _release,
    "S": _since,
}


def total_reach_ns(node: Node) -> int:
    """Return an upper bound of how far apart in time, in ns, one instant and its causes can be."""
    return node.reach_ns + sum(total_reach_ns(arg) for arg in node.args)


__all__ = ["LIMIT", "TRUE", "Atom", "Builder", "Node", "total_reach_ns"]
