"""LTL over an explored closed loop: its product with the automaton of what is not to happen.

A state of the product is a state of the loop, what the observers of the past keep there, and what
the automaton has yet to see. The scan that led to the loop's state has not been read: how long its
values stand is known only when the next step is taken. A run violates the property if the
automaton has seen enough (the shortest such beginning is shown), or if it can go on for ever
accepting, on a fair run (a lasso). Until-formulas are to the search of fair cycles just further
things that are pending, and done by a step in which they are not put off.

Of a step that merges scans the automaton reads every one. At a rest time may pass without end if
nothing is pending there; how many scans that are is left open, so that formulas which count scans
(X) or durations are not judged where scans are merged.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any, NamedTuple

from plcemu.monitor.formula import Formula
from plcemu.verify.check import (
    HOLDS,
    INCONCLUSIVE,
    VIOLATED,
    Evidence,
    Finding,
    NoCheck,
    negated,
)
from plcemu.verify.explore import Graph, backwards, explore
from plcemu.verify.fair import Lasso, Step, fair_components, lasso, run_to
from plcemu.verify.loop import Idle, Merge
from plcemu.verify.ltl.buchi import SATISFIED, Automaton
from plcemu.verify.ltl.linear import (
    FIRST,
    Translation,
    Unfit,
    asks_next,
    bounds,
    is_timed,
    unfit,
    units,
)
from plcemu.verify.ltl.observer import ENDLESS, Memory, Observer
from plcemu.verify.vacuity import idle_parts

STAY = Idle()
"""The action of a run that stays for ever where it is, at a rest or after a fault."""


class Place(NamedTuple):
    """A state of the product.

    Attributes:
        state: the number of the loop's state; the last scan that led to it is still to be read.
        kept: what the observers keep.
        wait_ns: for how long the automaton still waits, as it reads a run later than it happens.
        duty: the automaton's state.
        broken: the property is violated for good so many ns after a scan; -1 if it is not.
        scans: which scan of the step that led here that was; 0 is the last of the step before.
    """

    state: int
    kept: Memory
    wait_ns: int
    duty: int
    broken: int = -1
    scans: int = 0


class Edge(NamedTuple):
    """A step of the product.

    Attributes:
        action: of the loop; None if a violation is found in what has happened already.
        fulfilled: the untils not put off all the time, as bits.
        target: the state after it.
    """

    action: Any
    fulfilled: int
    target: Place


class Reading(NamedTuple):
    """How the reading of a scan may end.

    Attributes:
        broken: the ns in the scan at which the automaton has seen enough; -1 if it has not.
        kept, wait_ns, duty: as in `Place`.
        put_off: the untils put off all the time, as bits.
    """

    broken: int
    kept: Memory
    wait_ns: int
    duty: int
    put_off: int


class Reader:
    """Reads scans, one after the other, with observers and an automaton.

    Args:
        formula: what the runs satisfy that are looked for.
        atoms: state formulas, each with its bit in the letters that are read.
    """

    def __init__(self, formula: Formula, atoms: Sequence[Formula]) -> None:
        plan = Translation.of(formula)
        inputs: dict[Formula, int] = {atom: n for n, atom in enumerate(atoms)}
        self._first = 1 << len(atoms)
        inputs[FIRST] = len(atoms)
        self._guesses = [sum(bits) for bits in product(*[
            (0, 1 << len(inputs) + n) for n in range(len(plan.guesses))])]
        inputs.update((guess, len(atoms) + 1 + n) for n, guess in enumerate(plan.guesses))
        self._observer = Observer(plan.observed, inputs)
        self.automaton = Automaton(plan.tree)
        self._splits = FIRST in plan.observed
        self._every = (1 << self.automaton.untils) - 1
        self._known: dict[tuple[Memory, int, int, int, int], tuple[Reading, ...]] = {}
        self.begin = Reading(-1, self._observer.initial, plan.delay_ns, self.automaton.initial,
                             self._every)
        if self.begin.duty == SATISFIED:
            self.begin = self.begin._replace(broken=0)

    def read(self, kept: Memory, wait_ns: int, duty: int, letter: int, length_ns: int,
             ) -> tuple[Reading, ...]:
        """Read a scan whose values stand for a time, in all ways that the automaton may take.

        If it has seen enough, that is the only one, as nothing that follows matters.
        """
        key = kept, wait_ns, duty, letter, length_ns
        found = self._known.get(key)
        if found is None:
            found = self._known[key] = tuple(self._read(*key))
        return found

    def _read(self, kept: Memory, wait_ns: int, duty: int, letter: int, length_ns: int,
              ) -> Sequence[Reading]:
        begin = (0, kept, wait_ns, duty, self._every)
        todo = {begin}
        fresh = length_ns == 0
        ends: set[Reading] = set()
        broken: set[int] = set()
        while todo:
            at, kept, wait_ns, duty, put_off = todo.pop()
            if at == length_ns and not fresh:
                ends.add(Reading(-1, kept, wait_ns, duty, put_off))
                continue
            fresh = False
            first = at == 0 and self._splits
            ahead = min(1 if first and length_ns else length_ns - at, wait_ns or ENDLESS)
            for guess in self._guesses:
                bits = letter | guess | (self._first if at == 0 else 0)
                piece = next(self._observer.pieces(kept, bits, ahead))
                until = at + piece.length_ns
                if wait_ns:
                    todo.add((until, piece.after, wait_ns - piece.length_ns, duty, put_off))
                    continue
                for move in self.automaton.moves(duty, piece.bits):
                    if move.after == SATISFIED:
                        broken.add(at)
                    todo.add((until, piece.after, 0, move.after, put_off & move.put_off))
        if broken:
            return [Reading(min(broken), kept, 0, SATISFIED, 0)]
        return sorted(ends, key=lambda reading: (reading.duty, reading.put_off))


class Product:
    """The loop and a reader as one transition system, and what is pending in it."""

    def __init__(self, evidence: Evidence, reader: Reader, mask: int) -> None:
        self.loop, self.graph, self.reader = evidence.loop, evidence.graph, reader
        self._first, self._mask = evidence.first_tested, mask
        self._merged, self._timed = self.loop.merge == "stable", self.loop.merge == "timed"
        self._scan_ns = ENDLESS if self._merged else 0 if self._timed else self.loop.cycle_ns
        self._untils = tuple(f"until {n}" for n in range(reader.automaton.untils))
        self._letters: dict[int, int] = {}
        self._words: dict[tuple[int, Any], list[int]] = {}
        self.roots: dict[Place, list[Hashable]] = {}
        """The initial states, each with the plant's initial states that lead to it."""

    # ------------------------------------------------------------ the transition system

    def initial(self) -> Iterator[Place]:
        """The loop's initial states; of the scans that led there all but the last are read."""
        for plant, number in self.loop.starts(self.graph.number):
            scans = self.loop.first_scans(plant)[0]
            begin = self.reader.begin
            word = [(self._letter(*scan), self._scan_ns) for scan in
                    (scans if self._timed else scans[:-1])]
            for n, reading in self._through([(0, begin)], word):
                place = Place(number, *reading[1:4], reading.broken, n + 1 if reading.broken >= 0
                              else 0)
                if place not in self.roots:
                    yield place
                self.roots.setdefault(place, []).append(plant)

    def actions(self, place: Place) -> list[Edge]:
        """The ways on: the loop's steps, or staying at a rest, as the automaton may read them."""
        if place.broken >= 0:
            return []
        graph, state, found = self.graph, place.state, []
        begin = Reading(-1, *place[1:4], -1)
        steps = list(zip(graph.actions(state), graph.targets(state), strict=True))
        if graph.expanded(state) and (self._merged or not steps):
            steps.append((STAY, state))
        for action, target in steps:
            word, scans = self._word(state, action)
            for n, reading in self._through([(0, begin)], word):
                untils = ~reading.put_off & (1 << len(self._untils)) - 1
                seen = n + len(scans) - len(word) + 1
                kept = seen if reading.broken >= 0 else 0
                early = reading.broken >= 0 and seen == 0
                found.append(Edge(None if early else action, untils, Place(
                    state if early else target, *reading[1:4], reading.broken, kept)))
        return list(dict.fromkeys(found))

    def next(self, place: Place, edge: Edge) -> Place:
        """The state after a step."""
        return edge.target

    def pending(self, place: Place) -> Collection[str]:
        """Every until, and what is under way in the plant."""
        graph = self.graph
        if not graph.targets(place.state):
            return self._untils
        return (*self._untils, *self.loop.pending(graph.states[place.state]))

    def done(self, edge: Edge) -> Collection[str]:
        """The untils that are not put off, and what an action brings about in the plant."""
        own = [name for n, name in enumerate(self._untils) if edge.fulfilled >> n & 1]
        return own if edge.action in (None, STAY) else [*own, *self.loop.done(edge.action)]

    # ------------------------------------------------------------ what is read

    def _through(self, readings: list[tuple[int, Reading]], word: Sequence[tuple[int, int]],
                 ) -> list[tuple[int, Reading]]:
        """Read scans one after the other; a reading comes with the number of its last scan."""
        for n, (letter, length_ns) in enumerate(word):
            following: dict[tuple[int, Reading], None] = {}
            for at, before in readings:
                if before.broken >= 0:
                    following[at, before] = None
                    continue
                for now in self.reader.read(*before[1:4], letter, length_ns):
                    following[n, now._replace(put_off=before.put_off & now.put_off)] = None
            readings = list(following)
        return readings

    def _word(self, state: int, action: Any) -> tuple[list[tuple[int, int]], Sequence[int]]:
        """Return what is read in a step, each with how long it stands, and the step's scans of it.

        What is read first is the scan before the action, and last comes the scan before the
        step's last. In time, where scans take none, it is either all scans, or time that passes.
        """
        source = self.graph.states[state]
        if state not in self._letters:
            self._letters[state] = self._letter(source.memory, source.plant)
        ns = self.loop.cycle_ns if action is STAY else self.loop.elapsed_ns(source, action)
        before = (self._letters[state], ENDLESS if self._merged else ns)
        if action is STAY or self.loop.merge == "none":
            return [before], ()
        key = state, action
        if key not in self._words:
            self._words[key] = [self._letter(*s) for s in self.loop.scans(source, action)[0]]
        scans = self._words[key]
        if not self._timed:
            return [before, *((letter, ENDLESS) for letter in scans[:-1])], scans[:-1]
        return ([(letter, 0) for letter in scans], scans) if scans else ([before], ())

    def _letter(self, memory: bytes, plant: Hashable) -> int:
        bits = self.loop.watch(memory, self.loop.facts(plant))
        return bits >> self._first & self._mask


@dataclass
class Search:
    """The search for a run that satisfies a formula.

    Attributes:
        product: what is searched.
        graph: its states.
        broken: those in which the automaton has seen enough.
        cycles: the components in which a run can go on for ever, accepting and fair.
    """

    product: Product
    graph: Graph[Place, Edge]
    broken: list[int] = field(default_factory=list)
    cycles: list[list[int]] = field(default_factory=list)

    @staticmethod
    def of(evidence: Evidence, formula: Formula, atoms: Sequence[Formula], first: bool) -> Search:
        """Search; the `first` one found is enough, or all initial states are to be told apart."""
        system = Product(evidence, Reader(formula, atoms), (1 << len(atoms)) - 1)
        graph = explore(system, evidence.limits,
                        found=lambda n, place: first and place.broken >= 0)
        found = Search(system, graph)
        found.broken = [n for n, place in enumerate(graph.states) if place.broken >= 0]
        if not (first and found.broken):
            found.cycles = list(fair_components(graph, system, lambda n: True,
                                                evidence.loop.fairness == "strong"))
        return found

    @property
    def succeeds(self) -> bool:
        """Whether there is such a run."""
        return bool(self.broken or self.cycles)

    def origins(self) -> set[Hashable]:
        """Return the plant's initial states from which there is one."""
        goal = [*self.broken, *(n for c in self.cycles for n in c)]
        reached = backwards(self.graph, goal)
        return {plant for n in self.graph.initial if n in reached
                for plant in self.product.roots[self.graph.states[n]]}

    def run(self) -> tuple[Lasso, tuple[int | None, int] | None]:
        """Return a run of the loop, and where in its last step it is decided, if it is.

        That is the number of scans of that step, None for all, and the ns after the last of them.
        """
        if self.broken:
            at = self.broken[0]
            origin, stem = run_to(self.graph, at)
            place = self.graph.states[at]
            return self._told(Lasso(origin, stem, [])), (place.scans or None, place.broken)
        strong = self.product.loop.fairness == "strong"
        component = min(self.cycles, key=min)
        return self._told(lasso(self.graph, self.product, component, strong)), None

    def _told(self, run: Lasso) -> Lasso:
        root = self.graph.states[run.start]
        stem, cycle = ([Step(s.action.action, s.action.target.state) for s in steps
                        if s.action.action not in (None, STAY)] for steps in (run.stem, run.cycle))
        return Lasso(root.state, stem, cycle, self.product.roots[root][0])


@dataclass(frozen=True, slots=True)
class Linear:
    """A formula of LTL, with the past and durations: it holds if every fair run satisfies it."""

    of_endless_runs = True
    formula: Formula
    tested: tuple[Formula, ...]
    watched: tuple[Formula, ...] = ()

    @staticmethod
    def of(formula: Formula) -> Linear | NoCheck:
        """Return the check of a formula, or why it cannot be judged."""
        reason = unfit(formula)
        if reason:
            return NoCheck(reason)
        try:
            Translation.of(negated(formula))
        except Unfit as problem:
            return NoCheck(str(problem))
        return Linear(formula, tuple(dict.fromkeys(units(formula))))

    def unfit_for(self, merge: Merge) -> str:
        """What counts scans needs every one; what measures time, that time is kept."""
        if merge != "none" and asks_next(self.formula):
            return "it counts scans (X), and scans are merged: verify with merge: none"
        if merge == "stable" and is_timed(self.formula):
            return "it speaks of durations, which are abstracted away here"
        if merge == "timed" and (bounds(self.formula) > 1
                                 or Translation.of(negated(self.formula)).is_late):
            return ("it compares several durations, which whole units of time may miss: verify "
                    "with merge: none")
        return ""

    def judge(self, evidence: Evidence) -> Finding:
        """Violated by a run that satisfies the negation; vacuous in parts that do not matter."""
        graph = evidence.graph
        several = len(evidence.loop.origins) > 1
        search = Search.of(evidence, negated(self.formula), self.tested, not several)
        origins = search.origins() if several and graph.complete and search.graph.complete else None
        if search.succeeds:
            run, decided = search.run()
            return Finding(VIOLATED, run=run, decided=decided, violated_from=origins)
        if not (graph.complete and search.graph.complete):
            return Finding(INCONCLUSIVE, graph.reason or search.graph.reason)
        idle = idle_parts(self.formula, lambda stronger: self._holds(evidence, stronger))
        return Finding(HOLDS, vacuous_in=idle, violated_from=origins)

    def _holds(self, evidence: Evidence, formula: Formula) -> bool:
        search = Search.of(evidence, negated(formula), self.tested, True)
        return search.graph.complete and not search.succeeds
