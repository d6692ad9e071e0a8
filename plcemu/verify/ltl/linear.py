"""Linear formulas made ready for an automaton: what comes as a tree, what has been as leaves.

What speaks of the past, and of a bounded future, is a *signal*: its value at an instant is known a
fixed time later, from what has been by then. So signals are said of the past (`shifted`), and the
automaton reads all of them that much later. A future without a bound stays in the tree.

* Where a bounded future is what `G` or `F` asks at the top, it is said of the past at once, so that
  a violation is found at the first instant that decides it: `F (p & G[0,b] !q)` becomes
  `F (!q S[b,inf) (p & !q))`.
* Where an unbounded future stands below an operator of the past, or below one with an interval,
  the automaton guesses it as the run goes on, and checks the guess by `G (guess <-> future)`.
  If the future in turn speaks of durations ahead, the formula is refused.
* `X p` asks of the first instant of the next scan, as the monitors do.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce

from plcemu.monitor.formula import (
    FALSE,
    OPERATORS,
    TRUE,
    Binary,
    Call,
    Deadlock,
    Formula,
    Interval,
    Kind,
    Literal,
    TagRef,
    Unary,
    children,
    is_state,
    rebuilt,
    walk,
)
from plcemu.monitor.linear import looks_back
from plcemu.verify.check import negated
from plcemu.verify.ltl.buchi import (
    BOTTOM,
    TOP,
    Tree,
    both,
    either,
    following,
    leaf,
    release,
    until,
)

FIRST = TagRef("the first instant of a scan")
"""An input of observers: true in the first ns of every scan."""

_FUTURE = frozenset(("X", "F", "G", "U", "W", "R"))
_PULSES = (Kind.PULSE, Kind.EARLIER)
_START = Unary("!", Unary("Y", TRUE))
_MOST_CASES = 32
"""Cases that a disjunction is divided into; beyond them it is decided later, but not otherwise."""


class Unfit(Exception):
    """A formula cannot be judged; the text says why."""


def unfit(formula: Formula) -> str:
    """Return why a formula is not one of linear time that can be judged; empty if it is."""
    for part in walk(formula):
        if isinstance(part, Deadlock) or (isinstance(part, (Unary, Binary)) and part.op != "-->"
                                          and OPERATORS[part.op].kind is Kind.BRANCHING):
            return (f"it mixes {_name(part)}, which speaks of other runs, with operators of one "
                    "run; there are formulas of CTL and formulas of LTL")
        if isinstance(part, Call) and part.name == "ago":
            return "it asks for a value some time before, which is not kept: ago"
        if isinstance(part, Unary) and OPERATORS[part.op].kind in _PULSES and not _is_truth(part):
            return f"it compares numbers of two scans: {part}"
        if _is_value(part) and not all(map(is_state, children(part))):
            return f"a temporal operator stands inside a comparison or function: {part}"
        if _is_value(part) and any(map(looks_back, children(part))):
            return f"it compares numbers of two scans: {part}"
    return ""


def _is_value(part: Formula) -> bool:
    """Whether a part compares or computes."""
    return not (isinstance(part, (Unary, Binary)) and OPERATORS[part.op].kind not in (
        Kind.COMPARISON, Kind.ARITHMETIC))


def _name(formula: Formula) -> str:
    return getattr(formula, "op", str(formula))


def _is_truth(part: Unary) -> bool:
    """Whether what a pulse looks at is certainly a truth value, by its form."""
    if part.op in ("rise", "fall"):
        return True
    arg = part.arg
    return isinstance(arg, (Unary, Binary)) and OPERATORS[arg.op].kind in (Kind.LOGIC,
                                                                           Kind.COMPARISON)


def is_timed(formula: Formula) -> bool:
    """Whether a formula speaks of durations."""
    return any(isinstance(p, (Unary, Binary)) and p.interval for p in walk(formula))


def bounds(formula: Formula) -> int:
    """Return how many ends of intervals a formula has, 0 and infinity apart."""
    intervals = [p.interval for p in walk(formula) if isinstance(p, (Unary, Binary)) and p.interval]
    return sum((i.low_ns > 0) + (i.high_ns is not None) for i in intervals)


def asks_next(formula: Formula) -> bool:
    """Whether a formula counts scans."""
    return any(isinstance(p, Unary) and p.op == "X" for p in walk(formula))


def units(formula: Formula) -> Iterator[Formula]:
    """Yield the smallest parts of a formula that are true or false at an instant."""
    if isinstance(formula, Literal):
        return
    inner = isinstance(formula, (Unary, Binary)) and OPERATORS[formula.op].kind not in (
        Kind.COMPARISON, Kind.ARITHMETIC)
    if inner:
        for part in children(formula):
            yield from units(part)
    else:
        yield formula


def known(formula: Formula) -> Formula:
    """Return a formula without `-->`, and without intervals of `U`, `W`, `R`."""
    formula = rebuilt(formula, [known(part) for part in children(formula)])
    if isinstance(formula, Binary) and formula.op == "-->":
        return Unary("G", Binary("->", formula.left, Unary("F", formula.right)))
    if isinstance(formula, Binary) and formula.interval and formula.op in ("U", "W", "R"):
        first, last = formula.interval.first_ns, formula.interval.last_ns
        if formula.op == "R":
            return negated(_until(negated(formula.left), negated(formula.right), first, last))
        found = _until(formula.left, formula.right, first, last)
        return found if formula.op == "U" else Binary("|", found, _at("G", formula.left, 0, last))
    return formula


def _at(op: str, arg: Formula, first_ns: int, last_ns: int | None) -> Formula:
    """Return an operator with an interval, both ends of which belong to it."""
    if first_ns == 0 and last_ns is None:
        return Unary(op, arg)
    return Unary(op, arg, Interval(first_ns, last_ns, True, last_ns is not None))


def _until(p: Formula, q: Formula, first: int, last: int | None) -> Formula:
    """Return p U[first,last] q by operators with one operand and those without an interval."""
    if first:
        ahead = _until(p, q, 0, None if last is None else last - first)
        return Binary("&", _at("G", p, 0, first - 1), _at("F", ahead, first, first))
    if last == 0:
        return q
    return Binary("U", p, q) if last is None else \
        Binary("&", _at("F", q, 0, last), Binary("W", p, q))


# ---------------------------------------------------------------- signals


def _has_future(formula: Formula) -> bool:
    return any(isinstance(p, (Unary, Binary)) and p.op in _FUTURE for p in walk(formula))


def _bounds(formula: Unary) -> tuple[int, int | None]:
    interval = formula.interval or Interval()
    return interval.first_ns, interval.last_ns


def _is_bounded(formula: Formula) -> bool:
    """Whether a formula is F or G with an upper bound."""
    return isinstance(formula, Unary) and formula.op in ("F", "G") \
        and _bounds(formula)[1] is not None


def _is_logic(formula: Formula) -> bool:
    return isinstance(formula, (Unary, Binary)) and OPERATORS[formula.op].kind is Kind.LOGIC


def is_signal(formula: Formula) -> bool:
    """Whether a formula's value at an instant is known a fixed time later."""
    ahead = isinstance(formula, (Unary, Binary)) and formula.op in _FUTURE
    return (not ahead or _is_bounded(formula)) and all(map(is_signal, children(formula)))


def reach_ns(signal: Formula) -> int:
    """Return how much later the value of a signal is known."""
    if not _has_future(signal):
        return 0
    own = _bounds(signal)[1] or 0 if isinstance(signal, Unary) and _is_bounded(signal) else 0
    return own + max(map(reach_ns, children(signal)))


def shifted(signal: Formula, ns: int) -> Formula:
    """Return a formula of the past that says what a signal was so much before.

    Before that time since the start it says nothing of use.
    """
    if not _has_future(signal):
        return signal if ns == 0 or isinstance(signal, Literal) else _at("O", signal, ns, ns)
    if isinstance(signal, Unary) and _is_bounded(signal):
        first, last = _bounds(signal)
        inner = reach_ns(signal.arg)
        assert last is not None
        return _at("O" if signal.op == "F" else "H", shifted(signal.arg, inner),
                   ns - inner - last, ns - inner - first)
    if isinstance(signal, (Unary, Binary)) and OPERATORS[signal.op].kind is Kind.PAST:
        inner = reach_ns(signal)
        return shifted(_since_start(signal, inner), ns - inner)
    return rebuilt(signal, [shifted(part, ns) for part in children(signal)])


def _since_start(past: Unary | Binary, ns: int) -> Formula:
    """Return an operator of the past, read so much later; what was before the start is left out."""
    begun = _at("O", TRUE, ns, None)
    if isinstance(past, Binary):
        right = Binary("&", begun, shifted(past.right, ns))
        return replace(past, left=shifted(past.left, ns), right=right)
    op = "->" if past.op == "H" else "&"
    return replace(past, arg=Binary(op, begun, shifted(past.arg, ns)))


def conjunction(parts: Sequence[Formula]) -> Formula:
    """Return p & q & ..., TRUE if there is none."""
    return reduce(lambda p, q: Binary("&", p, q), parts) if parts else TRUE


def _cases(formula: Formula, truth: bool = True) -> list[list[Formula]]:
    """Return a signal, or its negation, as a disjunction of conjunctions."""
    if not _has_future(formula):
        return [[formula if truth else negated(formula)]]
    if isinstance(formula, Unary) and formula.op == "!":
        return _cases(formula.arg, not truth)
    if isinstance(formula, Binary) and formula.op in ("&", "|", "->"):
        left = _cases(formula.left, truth if formula.op != "->" else not truth)
        right = _cases(formula.right, truth)
        if (formula.op == "&") != truth:
            return left + right
        return [a + b for a in left for b in right]
    if truth or not isinstance(formula, Unary) or not _is_bounded(formula):
        return [[formula if truth else negated(formula)]]
    return [[replace(formula, op="F" if formula.op == "G" else "G", arg=negated(formula.arg))]]


def somewhere(signal: Formula, from_ns: int = 0, until_ns: int | None = None) -> list[Formula]:
    """Return formulas of the past one of which is true somewhere exactly if a signal is.

    Each becomes true at the first instant at which that is known.

    Args:
        signal: at some instant from `from_ns` to `until_ns` after the start.
        from_ns, until_ns: see there; both ends belong to it, None is without end.
    """
    cases = _cases(signal)
    if len(cases) > _MOST_CASES:
        cases = [[signal]]
    inside = [] if (from_ns, until_ns) == (0, None) else [_at("O", _START, from_ns, until_ns)]
    return [past for case in cases for past in _case([*inside, *case])]


def _case(parts: list[Formula]) -> list[Formula]:
    """Return the same for a conjunction."""
    ahead = [part for part in parts if _has_future(part)]
    now = conjunction([part for part in parts if part not in ahead])
    if not ahead:
        return [now]
    only = ahead[0]
    if len(ahead) == 1 and isinstance(only, Unary) and _is_bounded(only):
        first, last = _bounds(only)
        if only.op == "F":
            been = _at("O", now, first, last) if last else now
            return somewhere(Binary("&", been, only.arg))
        if first == 0 and not _has_future(only.arg):
            begins = Binary("&", now, only.arg)
            return [Binary("S", only.arg, begins, Interval(last or 0, None))]
    ns = max(map(reach_ns, ahead))
    began = _at("O", TRUE, ns, None)
    return [conjunction([began, *(shifted(part, ns) for part in parts)])]


# ---------------------------------------------------------------- trees


@dataclass(slots=True)
class Translation:
    """A formula as a tree over observed formulas of the past.

    Attributes:
        tree: what the automaton is made of.
        observed: what is observed, by the numbers of the tree's leaves.
        guesses: what is guessed, as inputs of the observer.
        delay_ns: how much later than it happens the automaton reads a run.
        by_scan: whether the automaton steps from scan to scan, so that X is its own next step.
    """

    tree: Tree = TOP
    observed: list[Formula] = field(default_factory=list)
    guesses: list[TagRef] = field(default_factory=list)
    delay_ns: int = 0
    by_scan: bool = True
    _numbers: dict[Formula, int] = field(default_factory=dict)
    _guessed: dict[Formula, TagRef] = field(default_factory=dict)

    @property
    def is_late(self) -> bool:
        """Whether a run is read later than it happens, at instants of a ns."""
        parts = [p.interval for f in self.observed for p in walk(f)
                 if isinstance(p, Unary) and p.interval]
        return self.delay_ns > 0 or any(i.first_ns == i.last_ns != 0 for i in parts)

    @staticmethod
    def of(formula: Formula) -> Translation:
        """Translate a formula for which `unfit` has nothing to say."""
        formula = known(formula)
        found = Translation(by_scan=not any(
            isinstance(p, (Unary, Binary)) and (p.interval or p.op == "Y"
                                                or OPERATORS[p.op].kind in _PULSES)
            for p in walk(formula)))
        found._make(formula, at_once=True)
        if found.delay_ns:
            # What is read later cannot stand beside what is read at once.
            found = Translation(by_scan=found.by_scan)
            found._make(formula, at_once=False)
        return found

    def _make(self, formula: Formula, at_once: bool) -> None:
        tree = self._top(formula, True) if at_once else self._tree(formula, True)
        checked: set[Formula] = set()
        while len(checked) < len(self._guessed):
            for future, guess in list(self._guessed.items()):
                if future not in checked:
                    checked.add(future)
                    right = both(self._leaf(guess, True), self._tree(future, True))
                    wrong = both(self._leaf(guess, False), self._tree(future, False))
                    tree = both(tree, release(BOTTOM, either(right, wrong)))
        self.tree = tree
        signals = list(self._numbers)
        self.delay_ns = max(map(reach_ns, signals), default=0)
        self.observed = [shifted(signal, self.delay_ns) for signal in signals]
        self.guesses = list(self._guessed.values())

    def _leaf(self, signal: Formula, truth: bool) -> Tree:
        if isinstance(signal, Literal):
            return TOP if bool(signal.value) == truth else BOTTOM
        return leaf(self._numbers.setdefault(signal, len(self._numbers)), truth)

    def _top(self, f: Formula, truth: bool) -> Tree:
        """Return the tree of a formula at the start of a run."""
        if isinstance(f, Unary) and f.op == "!":
            return self._top(f.arg, not truth)
        if isinstance(f, Binary) and f.op in ("&", "|", "->"):
            join = both if (f.op == "&") == truth else either
            return join(self._top(f.left, truth != (f.op == "->")), self._top(f.right, truth))
        some = (f.op == "F") == truth if isinstance(f, Unary) else False
        if isinstance(f, Unary) and f.op in ("F", "G") and is_signal(f.arg) \
                and (some or _bounds(f)[1] is None):
            body = f.arg if f.op == "F" else negated(f.arg)
            found = [self._leaf(past, some) for past in somewhere(body, *_bounds(f))]
            return until(TOP, reduce(either, found)) if some else \
                release(BOTTOM, reduce(both, found))
        return self._tree(f, truth)

    def _tree(self, f: Formula, truth: bool) -> Tree:
        """Return the tree of a formula, or of its negation."""
        if is_signal(f):
            return self._leaf(f, truth)
        if isinstance(f, Unary):
            return self._unary(f, truth)
        assert isinstance(f, Binary)
        op, p, q = f.op, f.left, f.right
        if op in ("&", "|"):
            join = both if (op == "&") == truth else either
            return join(self._tree(p, truth), self._tree(q, truth))
        if op == "->":
            return (either if truth else both)(self._tree(p, not truth), self._tree(q, truth))
        if op in ("<->", "xor"):
            same = (op == "<->") == truth
            return either(both(self._tree(p, True), self._tree(q, same)),
                          both(self._tree(p, False), self._tree(q, not same)))
        if op not in _FUTURE:
            return self._leaf(self._settled(f), truth)
        if op == "W":
            p, q, op = q, Binary("|", p, q), "R"
        make = until if (op == "U") == truth else release
        return make(self._tree(p, truth), self._tree(q, truth))

    def _unary(self, f: Unary, truth: bool) -> Tree:
        if f.op == "!":
            return self._tree(f.arg, not truth)
        if f.op == "X":
            inner = self._tree(f.arg, truth)
            if self.by_scan:
                return following(inner)
            begins = either(self._leaf(FIRST, False), inner)
            return following(release(self._leaf(FIRST, True), begins))
        if f.op in ("F", "G") and _bounds(f) == (0, None):
            inner = self._tree(f.arg, truth)
            return until(TOP, inner) if (f.op == "F") == truth else release(BOTTOM, inner)
        return self._leaf(self._settled(f), truth)

    def _settled(self, f: Formula) -> Formula:
        """Return a signal that is equal to a formula if every guess is right."""
        if is_signal(f):
            return f
        if isinstance(f, Unary) and f.op in ("F", "G") and _bounds(f)[0]:
            first, last = _bounds(f)
            ahead = self._settled(f.arg) if last is not None else self._guess(Unary(f.op, f.arg))
            return _at(f.op, ahead, first, first if last is None else last)
        if isinstance(f, (Unary, Binary)) and f.op in _FUTURE and not _is_bounded(f):
            return self._guess(f)
        return rebuilt(f, [self._settled(part) for part in children(f)])

    def _guess(self, f: Formula) -> TagRef:
        """Return what stands for a future without a bound; it changes only when its parts do.

        Raises:
            Unfit: it changes at other instants.
        """
        if any(_is_bounded(part) for part in walk(f)):
            raise Unfit(f"{f} has durations in it, no bound of its own, and stands below an "
                        "operator of the past or with an interval")
        return self._guessed.setdefault(f, TagRef(f"whether {f}"))


__all__ = ["FALSE", "FIRST", "Translation", "asks_next", "is_signal", "is_timed", "known",
           "reach_ns", "shifted", "somewhere", "unfit", "units"]
