"""Computation tree logic over an explored closed loop, with counterexamples and witnesses.

Every operator is written in terms of EX, E U and EG (Clarke, Emerson, Sistla, 1986). Runs are those
that are fair, weakly or strongly as the loop says, which matters for EG alone: every run can be
continued fairly, as what is pending can be done. A state in which nothing can happen is followed
by itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from plcemu.monitor.formula import (
    OPERATORS,
    TRUE,
    Binary,
    Formula,
    Kind,
    Literal,
    Unary,
)
from plcemu.verify.check import (
    HOLDS,
    INCONCLUSIVE,
    VIOLATED,
    Evidence,
    Finding,
    is_plain,
    negated,
)
from plcemu.verify.fair import Lasso, Step, run_to, way
from plcemu.verify.loop import Merge
from plcemu.verify.ltl.linear import units
from plcemu.verify.vacuity import idle_parts

_LOGIC = ("!", "&", "|", "->", "<->", "xor")


def _both(p: Formula, q: Formula) -> Formula:
    return Binary("&", p, q)


def _either(p: Formula, q: Formula) -> Formula:
    return Binary("|", p, q)


def _until(p: Formula, q: Formula) -> Formula:
    return Binary("EU", p, q)


def _always(p: Formula) -> Formula:
    return Unary("EG", p)


_UNARY: dict[str, Callable[[Formula], Formula]] = {
    "AX": lambda p: negated(Unary("EX", negated(p))),
    "AG": lambda p: negated(_until(TRUE, negated(p))),
    "AF": lambda p: negated(_always(negated(p))),
    "EF": lambda p: _until(TRUE, p),
}

_BINARY: dict[str, Callable[[Formula, Formula], Formula]] = {
    "AU": lambda p, q: negated(_either(_until(negated(q), _both(negated(p), negated(q))),
                                       _always(negated(q)))),
    "AW": lambda p, q: negated(_until(negated(q), _both(negated(p), negated(q)))),
    "AR": lambda p, q: negated(_until(negated(p), negated(q))),
    "EW": lambda p, q: _either(_until(p, q), _always(p)),
    "ER": lambda p, q: _either(_until(q, _both(p, q)), _always(q)),
    "-->": lambda p, q: negated(_until(TRUE, _both(p, _always(negated(q))))),
    "->": lambda p, q: _either(negated(p), q),
    "<->": lambda p, q: _either(_both(p, q), _both(negated(p), negated(q))),
    "xor": lambda p, q: _either(_both(p, negated(q)), _both(negated(p), q)),
}
"""How each operator is said with !, &, |, EX, E U and EG."""


def core(formula: Formula) -> Formula:
    """Return a formula in terms of !, &, |, EX, E U and EG; what is plain stays as it is."""
    if is_plain(formula):
        return formula
    if isinstance(formula, Unary):
        rewrite = _UNARY.get(formula.op)
        return core(rewrite(formula.arg)) if rewrite else replace(formula, arg=core(formula.arg))
    if isinstance(formula, Binary):
        rewrite_two = _BINARY.get(formula.op)
        return core(rewrite_two(formula.left, formula.right)) if rewrite_two else \
            replace(formula, left=core(formula.left), right=core(formula.right))
    return formula


def is_ctl(formula: Formula) -> bool:
    """Whether a formula is one of CTL, without durations, over what is plain."""
    if is_plain(formula):
        return True
    if isinstance(formula, Unary):
        fits = formula.op == "!" or OPERATORS[formula.op].kind is Kind.BRANCHING
        return fits and not formula.interval and is_ctl(formula.arg)
    if isinstance(formula, Binary):
        fits = formula.op in _LOGIC or OPERATORS[formula.op].kind is Kind.BRANCHING
        return fits and not formula.interval and is_ctl(formula.left) and is_ctl(formula.right)
    return False


class Story(NamedTuple):
    """How a formula becomes true or false, from a state on.

    Attributes:
        steps: what is done.
        cycle: what is then repeated for ever.
        endless: whether the run stays in the cycle, or where the steps end if that is empty.
        remark: what is said of the last state, as no single run can show it; else empty.
    """

    steps: list[Step]
    cycle: list[Step]
    endless: bool = False
    remark: str = ""


@dataclass
class Model:
    """Where formulas in core form hold.

    Attributes:
        evidence: the explored loop.
        numbers: of the smallest parts of formulas, among those that the check asks about.
    """

    evidence: Evidence
    numbers: dict[Formula, int]
    before: list[list[int]] = field(init=False)
    _found: dict[Formula, set[int]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.before = [[] for _ in range(len(self.evidence.graph))]
        for source in range(len(self.before)):
            for target in self.after(source):
                self.before[target].append(source)

    def after(self, state: int) -> Any:
        """The successors of a state; itself if nothing can happen."""
        return self.evidence.graph.targets(state) or (state,)

    def where(self, formula: Formula) -> set[int]:
        """Return the states in which a formula holds."""
        found = self._found.get(formula)
        if found is None:
            found = self._found[formula] = self._where(formula)
        return found

    def _where(self, formula: Formula) -> set[int]:
        every = range(len(self.before))
        if formula in self.numbers:
            number = self.numbers[formula]
            return {n for n in every if self.evidence.shows(number, n)}
        if isinstance(formula, Literal):
            return set(every) if formula == TRUE else set()
        if isinstance(formula, Unary):
            inner = self.where(formula.arg)
            if formula.op == "!":
                return set(every) - inner
            return {n for t in inner for n in self.before[t]} if formula.op == "EX" else \
                self._staying(inner)
        assert isinstance(formula, Binary)
        if formula.op in _BINARY:
            return self.where(_BINARY[formula.op](formula.left, formula.right))
        left, right = self.where(formula.left), self.where(formula.right)
        if formula.op == "EU":
            return self._reaching(left, right)
        return left & right if formula.op == "&" else left | right

    def _reaching(self, through: set[int], goal: set[int]) -> set[int]:
        reached, todo = set(goal), list(goal)
        while todo:
            for source in self.before[todo.pop()]:
                if source not in reached and source in through:
                    reached.add(source)
                    todo.append(source)
        return reached

    def _staying(self, inside: set[int]) -> set[int]:
        return self._reaching(inside, {n for c in self._ends(inside) for n in c})

    def _ends(self, inside: set[int]) -> Iterator[list[int]]:
        """Yield where a fair run can stay for ever inside."""
        graph = self.evidence.graph
        yield from ([n] for n in inside if not graph.targets(n))
        yield from self.evidence.endless(inside.__contains__)

    # ------------------------------------------------------------ what shows it

    def story(self, formula: Formula, state: int, truth: bool) -> Story:
        """Show that a formula has this truth value in a state, which it has."""
        if is_plain(formula):
            return Story([], [])
        if isinstance(formula, Unary) and formula.op == "!":
            return self.story(formula.arg, state, not truth)
        if isinstance(formula, Binary) and formula.op in ("&", "|"):
            parts = [p for p in (formula.left, formula.right)
                     if (state in self.where(p)) == truth]
            # E U comes before EG in the table: a run that ends says more than one that does not.
            parts = parts if truth else parts[::-1]
            told = next((p for p in parts if not is_plain(p)), parts[0])
            return self.story(told, state, truth)
        if not truth:
            return Story([], [], remark=_nowhere(formula))
        if isinstance(formula, Binary):
            return self._then(self._way(state, self.where(formula.left),
                                        self.where(formula.right)), formula.right, state)
        assert isinstance(formula, Unary)
        if formula.op == "EX":
            return self._then(self._once(state, self.where(formula.arg)), formula.arg, state)
        return self._stay(state, self.where(formula.arg))

    def _then(self, steps: list[Step], formula: Formula, state: int) -> Story:
        rest = self.story(formula, steps[-1].target if steps else state, True)
        return rest._replace(steps=[*steps, *rest.steps])

    def _way(self, state: int, through: set[int], goal: set[int]) -> list[Step]:
        return [] if state in goal else way(self.evidence.graph, through | goal, state,
                                            lambda step: step.target in goal)

    def _once(self, state: int, goal: set[int]) -> list[Step]:
        graph = self.evidence.graph
        return next(([Step(a, t)] for a, t in
                     zip(graph.actions(state), graph.targets(state), strict=True) if t in goal),
                    [])

    def _stay(self, state: int, inside: set[int]) -> Story:
        ends = {min(c): c for c in self._ends(inside)}
        steps = self._way(state, inside, set(ends))
        component = ends[steps[-1].target if steps else state]
        return Story(steps, self.evidence.lasso(component).cycle, True)


def _nowhere(formula: Formula) -> str:
    """Say in words that a formula in core form, EX, E U or EG, is false."""
    if isinstance(formula, Binary):
        way_there = "" if formula.left == TRUE else f" through {formula.left}"
        return f"from here on no run reaches {formula.right}{way_there}"
    assert isinstance(formula, Unary)
    return f"no next scan shows {formula.arg}" if formula.op == "EX" else \
        f"on no run from here does {formula.arg} stay true"


@dataclass(frozen=True, slots=True)
class Branching:
    """A formula of CTL, true if it holds in all initial states: after the first scan.

    Attributes:
        formula: as it is stated.
    """

    of_endless_runs = True
    formula: Formula
    tested: tuple[Formula, ...]
    watched: tuple[Formula, ...] = ()

    @staticmethod
    def of(formula: Formula) -> Branching | None:
        """Return the check if the formula is of this kind."""
        if is_plain(formula) or not is_ctl(formula):
            return None
        return Branching(formula, tuple(dict.fromkeys(units(formula))))

    def unfit_for(self, merge: Merge) -> str:
        """Every scan must be a state."""
        return "" if merge == "none" else \
            "it speaks of every scan, and scans are merged: verify with merge: none"

    def judge(self, evidence: Evidence) -> Finding:
        """Violated in an initial state where it does not hold; a run shows why."""
        graph = evidence.graph
        if not graph.complete:
            return Finding(INCONCLUSIVE, graph.reason)
        model = Model(evidence, {f: n for n, f in enumerate(self.tested)})
        formula = core(self.formula)
        holds = model.where(formula)
        bad = [n for n in graph.initial if n not in holds]
        if not bad:
            idle = idle_parts(self.formula, lambda stronger: all(
                n in model.where(core(stronger)) for n in graph.initial))
            return Finding(HOLDS, vacuous_in=idle, violated_from=set())
        told = model.story(formula, bad[0], truth=False)
        origin, stem = run_to(graph, bad[0])
        return Finding(VIOLATED, run=Lasso(origin, [*stem, *told.steps], told.cycle),
                       decided=None if told.endless else (None, 0), remark=told.remark,
                       violated_from={plant for plant, n in evidence.loop.starts(graph.number)
                                      if n in bad})

