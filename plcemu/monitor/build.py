"""Turns a linear formula into a network; every tag-only part becomes one atom.

Equal parts become one node, however often they stand in the formula.
"""

from __future__ import annotations

from collections.abc import Callable

from plcemu.monitor.bind import State
from plcemu.monitor.formula import Binary, Formula, Interval, Literal, Unary, is_state
from plcemu.monitor.network import (
    And,
    Atom,
    Constant,
    Network,
    NextAtom,
    Node,
    Not,
    Or,
    Since,
    Until,
    Window,
)
from plcemu.monitor.signals import NO, YES


class Builder:
    """Builds nodes.

    Attributes:
        nodes: the node of each part of the formula.
        order: all nodes, operands before those who use them.
        reach_ns: how far apart in time, in ns, an instant and what decides it can be.
    """

    def __init__(self, compile_state: Callable[[Formula], State]) -> None:
        self.compile_state = compile_state
        self.nodes: dict[Formula, Node] = {}
        self.order: list[Node] = []
        self.reach_ns = 0
        self._made: dict[tuple[object, ...], Node] = {}

    def network(self, formula: Formula, *watched: Formula) -> Network:
        """Return the network of a formula; the nodes of the `watched` parts are kept, too."""
        root = self.build(formula)
        self.reach_ns = _reach_ns(root)
        kept: set[int] = set()
        for node in (root, *(self.build(part) for part in watched)):
            _reach(node, kept)
        return Network([node for node in self.order if id(node) in kept], root)

    def build(self, formula: Formula) -> Node:
        """Return the node of a part."""
        if formula not in self.nodes:
            self.nodes[formula] = self._build(formula)
        return self.nodes[formula]

    def make(self, kind: type[Node], *args: Node | int) -> Node:
        """Return the node of a kind with these operands, the one there is or a new one."""
        if kind is Not and isinstance(args[0], Not):
            return args[0].args[0]
        key = (kind, *args)
        if key not in self._made:
            self._made[key] = kind(*args)  # type: ignore[arg-type]
            self.order.append(self._made[key])
        return self._made[key]

    def _build(self, formula: Formula) -> Node:
        if isinstance(formula, Literal):
            return self.make(Constant, YES if formula.value else NO)
        if is_state(formula):
            return self._atom(Atom, formula)
        if isinstance(formula, Unary) and formula.op == "X":
            return self._atom(NextAtom, formula.arg)
        if isinstance(formula, Unary):
            return _UNARY[formula.op](self, formula)
        assert isinstance(formula, Binary)
        return _BINARY[formula.op](self, formula)

    def _atom(self, kind: type[Atom], formula: Formula) -> Node:
        atom = kind(self.compile_state(formula))
        self.order.append(atom)
        return atom

    def eventually(self, arg: Node, low: int, high: int | None) -> Node:
        """Return F[low,high] p."""
        if high is not None:
            return self.make(Window, arg, low, high)
        ahead = self.make(Until, self.make(Constant, YES), arg)
        return self.make(Window, ahead, low, low) if low else ahead

    def once(self, arg: Node, low: int, high: int | None) -> Node:
        """Return O[low,high] p."""
        if high is not None:
            return self.make(Window, arg, -high, -low)
        behind = self.make(Since, self.make(Constant, YES), arg)
        return self.make(Window, behind, -low, -low) if low else behind

    def negated(self, node: Node) -> Node:
        """Return !p."""
        return self.make(Not, node)

    def bounded(self, left: Node, right: Node, interval: Interval | None, kind: type[Node],
                somewhere: Callable[[Node, int, int | None], Node]) -> Node:
        """Return p U[a,b] q or p S[a,b] q from the unbounded operator."""
        low, high = _bounds(interval)
        node = self.make(kind, left, right)
        if high is not None:
            node = self.make(And, node, somewhere(right, 0, high - low))
        if low:
            throughout = self.negated(somewhere(self.negated(left), 0, low - 1))
            node = self.make(And, throughout, somewhere(node, low, low))
        return node


def _bounds(interval: Interval | None) -> tuple[int, int | None]:
    interval = interval or Interval()
    return interval.first_ns, interval.last_ns


def _always(b: Builder, arg: Node, low: int, high: int | None) -> Node:
    return b.negated(b.eventually(b.negated(arg), low, high))


def _until(b: Builder, f: Binary) -> Node:
    return b.bounded(b.build(f.left), b.build(f.right), f.interval, Until, b.eventually)


def _since(b: Builder, f: Binary) -> Node:
    return b.bounded(b.build(f.left), b.build(f.right), f.interval, Since, b.once)


def _release(b: Builder, f: Binary) -> Node:
    left, right = b.negated(b.build(f.left)), b.negated(b.build(f.right))
    return b.negated(b.bounded(left, right, f.interval, Until, b.eventually))


def _weak_until(b: Builder, f: Binary) -> Node:
    return b.make(Or, _until(b, f), _always(b, b.build(f.left), 0, _bounds(f.interval)[1]))


def _implies(b: Builder, f: Binary) -> Node:
    return b.make(Or, b.negated(b.build(f.left)), b.build(f.right))


def _equivalent(b: Builder, f: Binary) -> Node:
    left, right = b.build(f.left), b.build(f.right)
    return b.make(And, b.make(Or, b.negated(left), right), b.make(Or, left, b.negated(right)))


_UNARY: dict[str, Callable[[Builder, Unary], Node]] = {
    "!": lambda b, f: b.negated(b.build(f.arg)),
    "F": lambda b, f: b.eventually(b.build(f.arg), *_bounds(f.interval)),
    "G": lambda b, f: _always(b, b.build(f.arg), *_bounds(f.interval)),
    "O": lambda b, f: b.once(b.build(f.arg), *_bounds(f.interval)),
    "H": lambda b, f: b.negated(b.once(b.negated(b.build(f.arg)), *_bounds(f.interval))),
    "Y": lambda b, f: b.make(Window, b.build(f.arg), -1, -1),
}
_BINARY: dict[str, Callable[[Builder, Binary], Node]] = {
    "&": lambda b, f: b.make(And, b.build(f.left), b.build(f.right)),
    "|": lambda b, f: b.make(Or, b.build(f.left), b.build(f.right)),
    "->": _implies,
    "<->": _equivalent,
    "U": _until,
    "W": _weak_until,
    "R": _release,
    "S": _since,
}


def _reach(node: Node, found: set[int]) -> None:
    """Note a node and all below it."""
    found.add(id(node))
    for arg in node.args:
        _reach(arg, found)


def _reach_ns(node: Node) -> int:
    own = max(abs(node.low_ns), abs(node.high_ns)) + 1 if isinstance(node, Window) \
        else int(isinstance(node, Atom) and node.state.pulsed)
    return own + max((_reach_ns(arg) for arg in node.args), default=0)
