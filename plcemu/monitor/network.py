"""Any linear formula as a network of nodes that learn, stretch by stretch, what is known.

Every node keeps the stretches of time on which its value is final. What becomes known of an atom
is handed up: each node works out what that makes known of itself and hands on just that. So the
work for a change is in proportion to what the change decides, not to what is kept, and a formula
is decided as early as its parts allow. What no node above still asks for is forgotten: memory is
bounded by the changes inside the windows that are open, and `LIMIT` bounds it where a formula
keeps windows open for ever, as `F (p & G q)` does.

Time is a whole number of ns since the first frame. Values are ordered NO < UNSURE < YES; UNSURE is
final too: it hinged on a value that was not known (bad quality). What is not final is open.
"""

from __future__ import annotations

from bisect import bisect_right

from plcemu.base.errors import LimitError
from plcemu.monitor.bind import State, Values
from plcemu.monitor.signals import (
    BEYOND,
    NO,
    UNSURE,
    YES,
    Signal,
    combined,
    negation,
    put,
    since,
    since_start,
    until,
    until_end,
    window,
)

LIMIT = 100_000
"""The largest number of stretches that a node keeps."""

Stretch = tuple[int, int, int]
"""First instant, last instant, value."""

Undo = tuple["Node", int, list[Stretch], int]
"""Which node, at which place, what stood there, how many stand there now."""


class Node:
    """One operation.

    Attributes:
        args: the operands.
        parents: who is told, and as which operand.
        known: the final stretches, in order; neighbours that touch differ in value.
        first: the first instant that is open, or that nobody asks for the ones before.
        need: the first instant that a parent may still ask for.
    """

    journal: list[Undo] | None = None
    keeps_order = False
    """Whether each instant builds on the one before, so that none may be passed over."""

    def __init__(self, *args: Node) -> None:
        self.args = args
        self.parents: list[tuple[Node, int]] = []
        self.known: list[Stretch] = []
        self.starts: list[int] = []
        self.first = 0
        self.need = 0

    def begin(self) -> None:
        """Learn what the operands know from the start; called once, operands first."""
        for which, arg in enumerate(self.args):
            for start, end, value in arg.known:
                self.learn(which, start, end, value)

    def learn(self, which: int, start: int, end: int, value: int) -> None:
        """Take it that an operand has become known on a stretch."""
        raise NotImplementedError

    def finite(self, args: list[Signal]) -> Signal:
        """Return the signal where all operands are known for ever."""
        raise NotImplementedError

    # ------------------------------------------------------------ what is known

    def at(self, t: int) -> int | None:
        """Return the value at an instant; None if it is open."""
        i = bisect_right(self.starts, t) - 1
        return self.known[i][2] if i >= 0 and self.known[i][1] >= t else None

    def within(self, start: int, end: int) -> list[Stretch]:
        """Return the known stretches that overlap one."""
        i = bisect_right(self.starts, start)
        if i and self.known[i - 1][1] >= start:
            i -= 1
        return self.known[i:bisect_right(self.starts, end)]

    def around(self, t: int) -> tuple[int, int, int, int]:
        """Return the stretch about an instant: least and greatest value, first and last instant."""
        i = bisect_right(self.starts, t) - 1
        if i >= 0 and self.known[i][1] >= t:
            start, end, value = self.known[i]
            return value, value, start, end
        before = self.known[i][1] + 1 if i >= 0 else 0
        after = self.starts[i + 1] - 1 if i + 1 < len(self.starts) else BEYOND
        return NO, YES, before, after

    def decide(self, start: int, end: int, value: int) -> None:
        """Make known what is still open of a stretch, and tell the parents."""
        start = max(start, self.first)
        known = self.known
        if known and start >= known[-1][0]:
            # Mostly time goes on: what is new begins where the last stretch ends, or later.
            start = max(start, known[-1][1] + 1)
        elif known:
            self._insert(start, end, value)
            return
        if end < start:
            return
        if self.journal is not None:
            self.journal.append((self, len(known), [], 1))
        if known and known[-1][1] == start - 1 and known[-1][2] == value:
            begin = known[-1][0]
            if self.journal is not None:
                self.journal[-1] = (self, len(known) - 1, known[-1:], 1)
            known[-1] = (begin, end, value)
        else:
            known.append((start, end, value))
            self.starts.append(start)
        for parent, which in self.parents:
            parent.learn(which, start, end, value)

    def _insert(self, start: int, end: int, value: int) -> None:
        """Make known what is still open of a stretch that does not begin in the last one."""
        if end < start:
            return
        known, starts = self.known, self.starts
        i = bisect_right(starts, start)
        if i and known[i - 1][1] >= start - 1:
            i -= 1
        j = i
        while j < len(known) and starts[j] <= end + 1:
            j += 1
        touched = known[i:j]
        fresh: list[tuple[int, int]] = []
        merged: list[Stretch] = []
        free = start
        for piece in touched:
            if free < piece[0] and free <= end:
                fresh.append((free, min(end, piece[0] - 1)))
                _join(merged, (*fresh[-1], value))
            _join(merged, piece)
            free = max(free, piece[1] + 1)
        if free <= end:
            fresh.append((free, end))
            _join(merged, (free, end, value))
        if not fresh:
            return
        if self.journal is not None:
            self.journal.append((self, i, touched, len(merged)))
        known[i:j] = merged
        starts[i:j] = [piece[0] for piece in merged]
        for a, b in fresh:
            for parent, which in self.parents:
                parent.learn(which, a, b, value)

    def undo(self, i: int, touched: list[Stretch], count: int) -> None:
        """Take back what was made known."""
        self.known[i:i + count] = touched
        self.starts[i:i + count] = [piece[0] for piece in touched]

    # ------------------------------------------------------------ forgetting

    def settle(self) -> None:
        """Move `first` over what has become known."""
        i = bisect_right(self.starts, self.first) - 1
        while 0 <= i < len(self.known) and self.known[i][0] <= self.first <= self.known[i][1]:
            self.first = self.known[i][1] + 1
            i += 1

    def asks_from(self) -> int:
        """Return the first instant that the operands are still asked for."""
        return self.first

    def forget(self) -> None:
        """Drop what nobody asks for.

        Raises:
            LimitError: too much is kept.
        """
        need = self.need
        if self.keeps_order:
            need = min(need, self.first - 1)
        else:
            self.first = max(self.first, need)
        if self.known and self.known[0][1] < need:
            count = 1
            while count < len(self.known) and self.known[count][1] < need:
                count += 1
            del self.known[:count], self.starts[:count]
        if len(self.known) > LIMIT:
            raise LimitError(f"more than {LIMIT} changes wait for a decision; bound the formula's "
                             "operators by intervals")

    # ------------------------------------------------------------ a run that is cut

    def cut(self, end: int, args: list[Signal]) -> Signal:
        """Return the signal if the run ended with an instant: what is not seen is not."""
        guess = self.finite([until_end(arg, end, NO) for arg in args])
        return _filled(self.known, guess, self.first)


def _join(pieces: list[Stretch], piece: Stretch) -> None:
    if pieces and pieces[-1][1] == piece[0] - 1 and pieces[-1][2] == piece[2]:
        pieces[-1] = (pieces[-1][0], piece[1], piece[2])
    else:
        pieces.append(piece)


def _filled(known: list[Stretch], guess: Signal, first: int) -> Signal:
    """Return the known stretches, and a signal where nothing is known."""
    result: Signal = []
    free = 0
    for start, end, value in known:
        _copy(result, guess, free, start)
        put(result, start, value)
        free = end + 1
    _copy(result, guess, free, BEYOND)
    return result or [(first, NO)]


def _copy(result: Signal, guess: Signal, start: int, end: int) -> None:
    """Append what a signal is from `start` to before `end`."""
    if start >= end:
        return
    i = max(0, bisect_right(guess, start, key=lambda piece: piece[0]) - 1)
    for begin, value in guess[i:]:
        if begin >= end:
            break
        put(result, max(begin, start), value)


class Constant(Node):
    """TRUE or FALSE."""

    def __init__(self, value: int) -> None:
        super().__init__()
        self.value = value
        self.known, self.starts = [(0, BEYOND, value)], [0]

    def finite(self, args: list[Signal]) -> Signal:
        return [(0, self.value)]

    def forget(self) -> None:
        """It is never too much."""


class Atom(Node):
    """A state formula; it holds its value until the next change."""

    def __init__(self, state: State) -> None:
        super().__init__()
        self.state = state
        self.value = NO
        self.last = -1

    def read(self, now: Values, before: Values, sure: bool) -> int:
        """Return the value for the values of the tags."""
        state = self.state
        if sure:
            return YES if state.holds(now, before) else NO
        found = state.kleene(now, before)
        return UNSURE if found is None else YES if found else NO

    def extend(self, t: int) -> None:
        """Take it that the value has held up to and with an instant."""
        if t > self.last:
            self.decide(self.last + 1, t, self.value)

    def finite(self, args: list[Signal]) -> Signal:
        return [(0, self.value)]

    def cut(self, end: int, args: list[Signal]) -> Signal:
        return until_end(_filled(self.known, [(0, self.value)], self.first), end, NO)


class NextAtom(Atom):
    """A state formula in the next scan; known when the scan after the last is known.

    A scan that leaves no frame changed nothing. Of the scans between two frames only the last
    shows what the second frame brings; it is taken to stand in the last ns before it.
    """

    def extend(self, t: int) -> None:
        """Time alone tells nothing of the next scan."""

    def reveal(self, t: int, value: int, next_scan: bool) -> None:
        """Take what came in the frame at an instant; `self.value` is for a scan without change."""
        if not next_scan:
            self.decide(self.last + 1, t - 2, self.value)
        self.decide(self.last + 1, t - 1, value)


class Not(Node):
    """Not p."""

    def learn(self, which: int, start: int, end: int, value: int) -> None:
        self.decide(start, end, YES - value)

    def finite(self, args: list[Signal]) -> Signal:
        return negation(args[0])


class And(Node):
    """p and q."""

    def learn(self, which: int, start: int, end: int, value: int) -> None:
        if value == NO:
            self.decide(start, end, NO)
            return
        for first, last, other in self.args[1 - which].within(start, end):
            self.decide(max(first, start), min(last, end), min(value, other))

    def finite(self, args: list[Signal]) -> Signal:
        return combined(args[0], args[1], min)


class Or(Node):
    """p or q."""

    def learn(self, which: int, start: int, end: int, value: int) -> None:
        if value == YES:
            self.decide(start, end, YES)
            return
        for first, last, other in self.args[1 - which].within(start, end):
            self.decide(max(first, start), min(last, end), max(value, other))

    def finite(self, args: list[Signal]) -> Signal:
        return combined(args[0], args[1], max)


class Window(Node):
    """p somewhere between two instants, both relative to now, in ns; before 0 it is nowhere."""

    def __init__(self, arg: Node, low_ns: int, high_ns: int) -> None:
        super().__init__(arg)
        self.low_ns, self.high_ns = low_ns, high_ns

    def begin(self) -> None:
        self.decide(0, -self.high_ns - 1, NO)
        super().begin()

    def learn(self, which: int, start: int, end: int, value: int) -> None:
        low, high = self.low_ns, self.high_ns
        if value == YES:
            self.decide(start - high, _later(end, -low), YES)
            return
        first, last = self._run(start)
        first = max(first - low, start - high)
        last = min(_later(last, -high), _later(end, -low))
        if first <= last:
            for begin, until_, found in self.args[0].within(max(0, first + low), last + high):
                if found == UNSURE:
                    self.decide(max(first, begin - high), min(last, until_ - low), UNSURE)
            self.decide(first, last, NO)

    def _run(self, t: int) -> tuple[int, int]:
        """Return the longest stretch about an instant on which p is known not to be YES."""
        known, starts = self.args[0].known, self.args[0].starts
        i = j = bisect_right(starts, t) - 1
        while i > 0 and known[i - 1][1] == known[i][0] - 1 and known[i - 1][2] != YES:
            i -= 1
        while j + 1 < len(known) and known[j + 1][0] == known[j][1] + 1 and known[j + 1][2] != YES:
            j += 1
        return (known[i][0] if known[i][0] > 0 else -BEYOND), known[j][1]

    def asks_from(self) -> int:
        return max(0, self.first + self.low_ns)

    def finite(self, args: list[Signal]) -> Signal:
        return window(args[0], self.low_ns, self.high_ns, 0)


def _later(t: int, by: int) -> int:
    """Return an instant so much later; what lasts for ever still does."""
    return BEYOND if t >= BEYOND else min(t + by, BEYOND)


class Until(Node):
    """p until q, without a bound: q comes, and p holds until then."""

    def learn(self, which: int, start: int, end: int, value: int) -> None:
        left, right = self.args
        t = end
        least, greatest = self.around(t + 1)[:2] if t < BEYOND else (NO, NO)
        while t >= self.first:
            own_least, own_greatest, own_start, _ = self.around(t)
            if own_least == own_greatest:
                if t < start:
                    return
                least, greatest, t = own_least, own_greatest, own_start - 1
                continue
            p_least, p_greatest, p_start, _ = left.around(t)
            q_least, q_greatest, q_start, _ = right.around(t)
            begin = max(own_start, p_start, q_start)
            least = max(q_least, min(p_least, least))
            greatest = max(q_greatest, min(p_greatest, greatest))
            if least == greatest:
                self.decide(begin, t, least)
            elif begin <= start:
                return
            t = begin - 1

    def finite(self, args: list[Signal]) -> Signal:
        return until(args[0], args[1])


class Since(Node):
    """p since q, without a bound: q has been, and p has held since."""

    keeps_order = True

    def learn(self, which: int, start: int, end: int, value: int) -> None:
        left, right = self.args
        t = max(start, self.first)
        least, greatest = self.around(t - 1)[:2] if t > 0 else (NO, NO)
        while t < BEYOND:
            own_least, own_greatest, _, own_end = self.around(t)
            if own_least == own_greatest:
                if t > end:
                    return
                least, greatest, t = own_least, own_greatest, own_end + 1
                continue
            p_least, p_greatest, _, p_end = left.around(t)
            q_least, q_greatest, _, q_end = right.around(t)
            last = min(own_end, p_end, q_end)
            least = max(q_least, min(p_least, least))
            greatest = max(q_greatest, min(p_greatest, greatest))
            if least == greatest:
                self.decide(t, last, least)
            elif last >= end:
                return
            t = last + 1

    def finite(self, args: list[Signal]) -> Signal:
        return since(args[0], args[1], NO)

    def cut(self, end: int, args: list[Signal]) -> Signal:
        left, right = (since_start(until_end(arg, end, NO), self.first) for arg in args)
        before = self.at(self.first - 1) if self.first else NO
        return _filled(self.known, since(left, right, NO if before is None else before),
                       self.first)


class Network:
    """The nodes of one formula.

    Args:
        order: all nodes, operands before those who use them.
        root: the node of the whole formula.
    """

    def __init__(self, order: list[Node], root: Node) -> None:
        self.order, self.root = order, root
        self.atoms = [node for node in order if isinstance(node, Atom)]
        self.asks_next = any(isinstance(node, NextAtom) for node in order)
        for node in order:
            node.parents = []
        for node in order:
            for which, arg in enumerate(node.args):
                arg.parents.append((node, which))
        for node in order:
            node.begin()

    def verdict(self) -> int | None:
        """Return the formula's value at the start; None while it is open."""
        return self.root.at(0)

    def pass_time(self, t: int) -> None:
        """Take it that nothing changed up to and with an instant."""
        for atom in self.atoms:
            atom.extend(t)
            if type(atom) is Atom and t > atom.last:
                atom.last = t

    def decided_by(self, t: int) -> bool:
        """Tell whether the verdict falls until an instant if nothing changes; nothing is kept."""
        journal: list[Undo] = []
        for node in self.order:
            node.journal = journal
        for atom in self.atoms:
            atom.extend(t)
        decided = self.verdict() is not None
        for node in self.order:
            node.journal = None
        for node, i, touched, count in reversed(journal):
            node.undo(i, touched, count)
        return decided

    def settle(self) -> None:
        """Move every node's `first` over what has become known."""
        for node in self.order:
            node.settle()

    def forget(self, kept: dict[Node, int]) -> None:
        """Drop what nobody asks for; `kept` says of some nodes from when on they are asked for.

        Raises:
            LimitError: too much is kept.
        """
        for node in self.order:
            node.need = kept.get(node, BEYOND)
        self.root.need = 0
        for node in reversed(self.order):
            node.forget()
            asks = node.asks_from()
            for arg in node.args:
                arg.need = min(arg.need, asks)

    def cut(self, end: int) -> int:
        """Return the formula's value at the start if the run ended with an instant."""
        signals: dict[int, Signal] = {}
        for node in self.order:
            signals[id(node)] = node.cut(end, [signals[id(arg)] for arg in node.args])
        return signals[id(self.root)][0][1]
