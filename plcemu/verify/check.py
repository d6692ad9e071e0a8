"""Properties judged over an explored closed loop: kinds of checks, and what they find.

A check says which state formulas it wants to see in every scan, and judges the graph by them. A
formula that no check of the table (`checks.py`) takes is inconclusive, never silently true.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

from plcemu.monitor.formula import (
    FALSE,
    OPERATORS,
    TRUE,
    Binary,
    Call,
    Deadlock,
    Formula,
    Kind,
    Literal,
    Unary,
    walk,
)
from plcemu.verify.explore import Graph, Limits, terminal
from plcemu.verify.fair import Lasso, fair_components, lasso, run_to
from plcemu.verify.loop import ClosedLoop, Merge, State
from plcemu.verify.vacuity import parts_of

HOLDS, VIOLATED, INCONCLUSIVE = "holds", "violated", "inconclusive"

StateGraph = Graph[State, Any]


@dataclass(slots=True)
class Finding:
    """What a check found.

    Attributes:
        verdict: `holds`, `violated` or `inconclusive`.
        reason: why it is inconclusive; else empty.
        out_of_scope: whether no check takes the formula, whatever is explored.
        vacuous_in: the parts of the formula that no run ever puts to the test.
        run: the counterexample of a violated property, or the witness of an `EF` that holds.
        watched: the watched formula that tells in which scan of the run's last step it is decided;
            None if the run has no such scan.
        bad: the states from which on a run violates; None if it does not depend on them.
        remark: what is said of the run's last state, as no single run can show it; else empty.
        decided: where in the run's last step it is decided, as the number of that step's scans,
            None for all, and the ns after the last of them; None if `watched` tells, or nothing.
        violated_from: the plant's initial states from which a run violates; None if `bad` tells.
    """

    verdict: str
    reason: str = ""
    out_of_scope: bool = False
    vacuous_in: tuple[str, ...] = ()
    run: Lasso | None = None
    watched: int | None = None
    bad: set[int] | None = None
    remark: str = ""
    decided: tuple[int | None, int] | None = None
    violated_from: set[Hashable] | None = None


@dataclass(slots=True)
class Evidence:
    """What a check may look at.

    Attributes:
        loop: the closed loop.
        graph: its states as far as they were explored.
        first: the number of the check's first watched formula.
        first_tested: the number of the check's first tested formula.
        now: tells whether a watched formula holds in the last scan before a state.
        limits: where a search of the check's own gives up.
    """

    loop: ClosedLoop
    graph: StateGraph
    first: int
    first_tested: int
    now: Callable[[int, State], bool]
    limits: Limits = Limits()  # noqa: RUF009

    def seen(self, number: int, state: int) -> bool:
        """Whether the check's watched formula held in a scan of the step to a state."""
        return bool(self.graph.states[state].seen >> (self.first + number) & 1)

    def holds(self, number: int, state: int) -> bool:
        """Whether it held in the last of these scans, where the run rests."""
        return self.now(self.first + number, self.graph.states[state])

    def shows(self, number: int, state: int) -> bool:
        """Whether the check's tested formula held in the last of these scans."""
        return self.now(self.first_tested + number, self.graph.states[state])

    def ever(self, number: int) -> bool:
        """Whether the check's tested formula held in any scan at all."""
        return bool(self.loop.ever >> (self.first_tested + number) & 1)

    def endless(self, inside: Callable[[int], bool]) -> Iterator[list[int]]:
        """Yield components in which a fair run can move for ever inside."""
        return fair_components(self.graph, self.loop, inside, self.loop.fairness == "strong")

    def lasso(self, component: Sequence[int]) -> Lasso:
        """Return a run into one of them and a fair cycle in it."""
        return lasso(self.graph, self.loop, component, self.loop.fairness == "strong")

    def rests(self) -> Iterator[int]:
        """Yield the states in which a fair run can stay for ever.

        Nothing can happen there, or, where a state is a rest, nothing has to.
        """
        loop, graph = self.loop, self.graph
        for n, state in enumerate(graph.states):
            ends = graph.expanded(n) and not graph.targets(n)
            if ends or (loop.merge == "stable" and not loop.pending(state)):
                yield n

    def first_seen(self, number: int) -> int | None:
        """The first state found in whose step the watched formula held."""
        bit = 1 << (self.first + number)
        return next((n for n, s in enumerate(self.graph.states) if s.seen & bit), None)


class Check(Protocol):
    """One kind of property."""

    @property
    def watched(self) -> tuple[Formula, ...]:
        """The state formulas that must be asked of every scan, and told for every step."""

    @property
    def tested(self) -> tuple[Formula, ...]:
        """State formulas of which it matters only whether they ever hold."""

    @property
    def of_endless_runs(self) -> bool:
        """Whether it depends on what a run may do for ever, and so on fairness."""

    def unfit_for(self, merge: Merge) -> str:
        """Why it cannot be judged of a loop that is looked at so; empty if it can."""

    def judge(self, evidence: Evidence) -> Finding:
        """Judge the property."""


# ---------------------------------------------------------------- kinds of properties


class _FitsAll:
    """A kind of property that can be judged however the loop is looked at."""

    __slots__ = ()

    def unfit_for(self, merge: Merge) -> str:
        """Nothing stands in the way."""
        return ""


@dataclass(frozen=True, slots=True)
class Invariant(_FitsAll):
    """`G p`, `AG p`, `A[] p`: p in every scan."""

    of_endless_runs = False

    formula: Formula
    watched: tuple[Formula, ...] = ()
    tested: tuple[Formula, ...] = ()
    parts: tuple[str, ...] = ()

    @staticmethod
    def of(formula: Formula) -> Invariant | None:
        """Return the check if the formula is of this kind."""
        if isinstance(formula, Unary) and formula.op in ("G", "AG") and not formula.interval \
                and is_plain(formula.arg):
            hard = list(without_a_part(formula.arg))
            return Invariant(formula.arg, (negated(formula.arg),),
                             tuple(negated(f) for f, _ in hard), tuple(text for _, text in hard))
        return None

    def judge(self, evidence: Evidence) -> Finding:
        """Violated where its negation is seen; vacuous in parts whose lack would not show."""
        at = evidence.first_seen(0)
        graph = evidence.graph
        if at is not None:
            bad = {n for n in range(len(graph)) if evidence.seen(0, n)}
            return Finding(VIOLATED, run=Lasso(*run_to(graph, at), []), watched=0, bad=bad)
        if not graph.complete:
            return Finding(INCONCLUSIVE, graph.reason)
        idle = [text for n, text in enumerate(self.parts) if not evidence.ever(n)]
        return Finding(HOLDS, vacuous_in=tuple(dict.fromkeys(idle)), bad=set())


@dataclass(frozen=True, slots=True)
class Reachable(_FitsAll):
    """`EF p`, `E<> p`: from some initial state, p in some scan."""

    of_endless_runs = False

    watched: tuple[Formula, ...]
    tested: tuple[Formula, ...] = ()

    @staticmethod
    def of(formula: Formula) -> Reachable | None:
        """Return the check if the formula is of this kind."""
        if isinstance(formula, Unary) and formula.op == "EF" and not formula.interval \
                and is_plain(formula.arg):
            return Reachable((formula.arg,))
        return None

    def judge(self, evidence: Evidence) -> Finding:
        """Holds where p is seen."""
        at = evidence.first_seen(0)
        if at is not None:
            return Finding(HOLDS, run=Lasso(*run_to(evidence.graph, at), []), watched=0)
        if not evidence.graph.complete:
            return Finding(INCONCLUSIVE, evidence.graph.reason)
        return Finding(VIOLATED)


@dataclass(frozen=True, slots=True)
class Recurrence(_FitsAll):
    """`G F p & G F q & ...` on every fair run: each again and again."""

    of_endless_runs = True

    wanted: tuple[Formula, ...]
    stronger: tuple[tuple[Formula, str], ...] = ()
    tested: tuple[Formula, ...] = ()

    @staticmethod
    def of(formula: Formula) -> Recurrence | None:
        """Return the check if the formula is of this kind."""
        wanted = []
        for part in conjuncts(formula):
            inner = part.arg if isinstance(part, Unary) and part.op == "G" else None
            if not (isinstance(inner, Unary) and inner.op == "F" and is_plain(inner.arg)) \
                    or inner.interval or part.interval:  # type: ignore[union-attr]
                return None
            wanted.append(inner.arg)
        stronger = tuple((part.stronger, part.meaning) for p in wanted for part in parts_of(p))
        return Recurrence(tuple(wanted), stronger) if wanted else None

    @property
    def watched(self) -> tuple[Formula, ...]:
        """What is wanted again and again, then the same with TRUE or FALSE for a part of it."""
        return (*self.wanted, *(formula for formula, _ in self.stronger))

    def judge(self, evidence: Evidence) -> Finding:
        """Violated by a rest without p, or a fair component through whose steps p is not seen."""
        graph = evidence.graph
        rests = list(evidence.rests())
        ends: list[int] = []
        cycles: list[list[int]] = []
        for number in range(len(self.wanted)):
            more_ends, more_cycles = _without(evidence, number, rests)
            ends += more_ends
            cycles += more_cycles
        bad = set().union(ends, *cycles)
        if bad:
            first = min(bad)
            run = Lasso(*run_to(graph, first), []) if first in ends else \
                evidence.lasso(min(cycles, key=min))
            return Finding(VIOLATED, run=run, bad=bad)
        if not graph.complete:
            return Finding(INCONCLUSIVE, graph.reason)
        idle = [text for number, (_, text) in enumerate(self.stronger, len(self.wanted))
                if not any(_without(evidence, number, rests))]
        return Finding(HOLDS, vacuous_in=tuple(dict.fromkeys(idle)), bad=bad)


def _without(evidence: Evidence, number: int,
             rests: Sequence[int]) -> tuple[list[int], list[list[int]]]:
    """Return the rests without a watched formula, and the fair components that never see it."""
    unseen = {n for n in range(len(evidence.graph)) if not evidence.seen(number, n)}
    return ([n for n in rests if not evidence.holds(number, n)],
            list(evidence.endless(unseen.__contains__)))


@dataclass(frozen=True, slots=True)
class NoDeadlock(_FitsAll):
    """`AG EX TRUE`, `A[] !deadlock`: in every state something can still happen, now or later."""

    of_endless_runs = False

    watched: tuple[Formula, ...] = ()
    tested: tuple[Formula, ...] = ()

    @staticmethod
    def of(formula: Formula) -> NoDeadlock | None:
        """Return the check if the formula is this one."""
        return NoDeadlock() if isinstance(formula, Unary) and formula.op == "AG" and \
            (formula.arg == Unary("EX", TRUE) or _is_no_deadlock(formula.arg)) else None

    def judge(self, evidence: Evidence) -> Finding:
        """Violated by a state in which nothing can happen; the way to the first one is shown."""
        graph = evidence.graph
        ends = set(terminal(graph))
        if ends:
            return Finding(VIOLATED, run=Lasso(*run_to(graph, min(ends)), []), bad=ends)
        doubt = graph.reason if not graph.complete else evidence.loop.deadlock_doubt
        return Finding(INCONCLUSIVE, doubt) if doubt else Finding(HOLDS, bad=ends)


def _is_no_deadlock(formula: Formula) -> bool:
    return isinstance(formula, Unary) and formula.op == "!" and isinstance(formula.arg, Deadlock)


@dataclass(frozen=True, slots=True)
class NoCheck(_FitsAll):
    """A formula that no check takes."""

    of_endless_runs = False

    reason: str
    watched: tuple[Formula, ...] = ()
    tested: tuple[Formula, ...] = ()

    def judge(self, evidence: Evidence) -> Finding:
        """Inconclusive, with the reason."""
        return Finding(INCONCLUSIVE, self.reason, out_of_scope=True)


# ---------------------------------------------------------------- formulas


def is_plain(formula: Formula) -> bool:
    """Whether a formula speaks of the values at one instant only, without rise, fall, changed."""
    parts = list(walk(formula))
    if any(isinstance(p, Deadlock) or (isinstance(p, Call) and p.name == "ago") for p in parts):
        return False
    return all(OPERATORS[p.op].kind in (Kind.LOGIC, Kind.COMPARISON, Kind.ARITHMETIC)
               for p in parts if isinstance(p, (Unary, Binary)))


def conjuncts(formula: Formula) -> Iterator[Formula]:
    """Yield the parts of a conjunction, left to right."""
    if isinstance(formula, Binary) and formula.op == "&":
        yield from conjuncts(formula.left)
        yield from conjuncts(formula.right)
    else:
        yield formula


def negated(formula: Formula) -> Formula:
    """Return not p."""
    if isinstance(formula, Literal):
        return FALSE if formula == TRUE else TRUE
    return formula.arg if isinstance(formula, Unary) and formula.op == "!" else \
        Unary("!", formula)


def without_a_part(formula: Formula) -> Iterator[tuple[Formula, str]]:
    """Yield stronger formulas, each without one part, and what it means if they hold as well.

    In p -> q, the conclusion is taken away: if that still holds, p is never true. In !(p & q) one
    conjunct after the other is: if that still holds, the other never was.
    """
    if isinstance(formula, Binary) and formula.op == "->":
        yield negated(formula.left), f"{formula.left} is never true"
    elif isinstance(formula, Unary) and formula.op == "!":
        parts = list(conjuncts(formula.arg))
        for n in range(len(parts) if len(parts) > 1 else 0):
            rest = joined([*parts[:n], *parts[n + 1:]])
            yield negated(rest), f"{rest} is never true"
    elif isinstance(formula, Binary) and formula.op == "&":
        for left, text in without_a_part(formula.left):
            yield replace(formula, left=left), text
        for right, text in without_a_part(formula.right):
            yield replace(formula, right=right), text


def joined(parts: Sequence[Formula]) -> Formula:
    """Return the conjunction of one or more formulas."""
    whole = parts[0]
    for part in parts[1:]:
        whole = Binary("&", whole, part)
    return whole
