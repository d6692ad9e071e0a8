"""All properties of one closed loop, judged together over one exploration."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from plant_sim.abstraction import Abstraction
from plcemu.base.collector import paused_collector
from plcemu.base.errors import CompileError
from plcemu.base.spans import Diagnostic
from plcemu.base.tags import Tag
from plcemu.engine.resource import Resource
from plcemu.io.mapping import Point
from plcemu.ir.program import Program
from plcemu.monitor.formula import Formula, tag_refs
from plcemu.monitor.parse import Property
from plcemu.monitor.suite import Suite
from plcemu.verify.check import (
    HOLDS,
    INCONCLUSIVE,
    VIOLATED,
    Check,
    Evidence,
    Finding,
    NoCheck,
    StateGraph,
)
from plcemu.verify.checks import check_for
from plcemu.verify.cone import cone_of
from plcemu.verify.explore import Limits, Progress, backwards, explore
from plcemu.verify.fair import Lasso, run_to
from plcemu.verify.loop import ClosedLoop, Fairness, Merge
from plcemu.verify.machine import ScanMachine, place_of
from plcemu.verify.path import Path, path_of
from plcemu.verify.predicates import Predicates
from plcemu.verify.timed.checks import reads_time, suited
from plcemu.verify.timed.loop import TimedLoop
from plcemu.verify.timed.path import timed_path_of
from plcemu.verify.timed.timing import Time, grounds, timed_loop

_FACT_TYPES = {"bool": "BOOL", "int": "LINT", "real": "LREAL"}
NO_FAULT = "no_fault"
_FAIRNESS: dict[Fairness, str] = {
    "weak": "fairness is weak: assumed is that nothing stays under way in the plant for ever "
            "without coming to its end",
    "strong": "fairness is strong: assumed is that what is under way in the plant again and again "
              "comes to its end again and again",
    "none": "fairness: none is assumed; the plant may also do nothing for ever"}


@dataclass(slots=True)
class Proof:
    """What became of one property.

    Attributes:
        name: of the property.
        formula: as text.
        description: in the user's words.
        finding: the verdict and what shows it.
        path: the counterexample, or the witness.
        initial: the verdict for each initial state by name; empty if there is only one.
        states: how many the exploration found.
        seconds: how long exploration and judgement took.
    """

    name: str
    formula: str
    description: str
    finding: Finding
    path: Path | None
    initial: dict[str, str]
    states: int
    seconds: float

    def as_json(self) -> dict[str, Any]:
        """Return it as plain values."""
        document: dict[str, Any] = {
            "name": self.name, "formula": self.formula, "description": self.description,
            "verdict": self.finding.verdict, "vacuous": bool(self.finding.vacuous_in),
            "vacuous_in": list(self.finding.vacuous_in), "reason": self.finding.reason,
            "remark": self.finding.remark,
            "states": self.states, "seconds": round(self.seconds, 3),
            "counterexample": None, "witness": None}
        if self.path is not None:
            key = "counterexample" if self.finding.verdict == VIOLATED else "witness"
            document[key] = self.path.as_json()
        if self.initial:
            document["initial"] = dict(self.initial)
        return document


@dataclass(slots=True)
class Result:
    """All proofs, what was explored, and what was cut away or assumed for it."""

    proofs: list[Proof]
    graph: StateGraph
    scans: int
    cuts: list[str] = field(default_factory=list)


class Prover:
    """A program, a finite plant and what is to be proved of them.

    Args:
        resource: the program on its engine.
        plant: the abstraction.
        inputs: where the plant's readings go.
        outputs: what its actuators follow.
        cycle_ns: the time between two scans.
        properties: what is demanded.
        merge: see `plcemu.verify.loop`.
        frozen: while this state formula holds, the plant does nothing; None if it always may.
        fairness: see `plcemu.verify.loop`.
        together: whether many steps are made at once; if not, one after the other, as is readable.
        time: how time is kept with `merge="timed"`; see `plcemu.verify.timed.timing`.

    Raises:
        CompileError: a property names what does not exist, or mixes up types.
        PlcemuError: the program cannot be verified in this way.
    """

    def __init__(self, resource: Resource, plant: Abstraction, inputs: Sequence[Point],
                 outputs: Sequence[Point], cycle_ns: int, properties: Sequence[Property],
                 merge: Merge = "stable", frozen: Formula | None = None,
                 fairness: Fairness = "weak", together: bool = True,
                 time: Time = "auto") -> None:
        self.cycle_ns, self.properties, self.frozen = cycle_ns, list(properties), frozen
        program = resource.program
        facts = [Tag(f"plant.{f.name}", _FACT_TYPES[f.kind], f.unit, comment=f.description)
                 for f in plant.facts]
        self.predicates = Predicates(program, facts)
        self.checks = [_check(p.formula, plant, merge) for p in self.properties]
        if merge == "timed":
            self.checks = [reads_time(self.predicates, p.formula) or check for p, check in
                           zip(self.properties, self.checks, strict=True)]
        judged = [p.formula for p, check in zip(self.properties, self.checks, strict=True)
                  if not isinstance(check, NoCheck)] + ([frozen] if frozen else [])
        diagnostics: list[Diagnostic] = [d for f in judged for d in self.predicates.check(f)]
        if diagnostics:
            raise CompileError(diagnostics)
        watched: list[Formula] = [f for c in self.checks for f in c.watched]
        formulas = watched + [f for c in self.checks for f in c.tested]
        looked_at = self.predicates.bytes_of(formulas)
        asked = looked_at | self.predicates.bytes_of([frozen] if frozen else [])
        for point in outputs:
            at = place_of(program, point)
            asked.update(range(at, at + point.width) if at is not None else ())
        kept = cone_of(program, asked)
        machine = ScanMachine(resource, inputs, kept)
        watching = self.predicates.mask(formulas), looked_at, (1 << len(watched)) - 1
        self.loop: ClosedLoop
        if merge == "timed":
            self.loop = timed_loop(time, program, kept, machine, plant, inputs, outputs, fairness,
                                   *watching)
            self.checks = [suited(self.loop, self.predicates, check) for check in self.checks]
        else:
            self.loop = ClosedLoop(machine, plant, inputs, outputs, *watching, merge, cycle_ns,
                                   self.predicates.test(frozen) if frozen else None, fairness,
                                   together)
        self.cuts = self._cuts(kept, merge) + _never_written(program, inputs, kept)
        if any(check.of_endless_runs for check in self.checks):
            self.cuts.append(_FAIRNESS[fairness])
        if frozen:
            self.cuts.append(f"assumed is that the plant does nothing while {frozen}")

    def _cuts(self, kept: frozenset[int] | None, merge: Merge) -> list[str]:
        """Return what is cut away or assumed, in words."""
        cuts = []
        if kept is None:
            cuts.append("no variable is cut away: the program reaches memory through addresses "
                        "that are not known before it runs")
        else:
            cut = [s.tag.name for s in self.predicates.slots if s.offset not in kept]
            clocks = [name for name in cut if name.endswith(".T")]
            names = [name for name in cut if name not in clocks]
            clock_text = [f"{len(clocks)} step times that nothing reads"] if clocks else []
            if cut:
                cuts.append("cut away, because nothing that is asked about depends on it: " +
                            ", ".join([*names, *clock_text]))
        if merge == "stable":
            cuts.append("scans are merged up to the next rest of program and plant: assumed is "
                        "that no event of the plant comes during the few scans until then")
        if isinstance(self.loop, TimedLoop):
            cuts += grounds(self.loop, self.cycle_ns)
        return cuts

    @paused_collector()
    def prove(self, limits: Limits = Limits(),  # noqa: B008
              on_progress: Callable[[Progress], None] | None = None) -> Result:
        """Explore, and judge every property; the scans told are those of the exploration."""
        before = self.loop.machine.scans
        graph = explore(self.loop, limits, on_progress=on_progress)
        scans = self.loop.machine.scans - before
        proofs = [self._judge(graph, limits, entry, check, *firsts) for entry, check, firsts in
                  zip(self.properties, self.checks, self._firsts(), strict=True)]
        fault = self._fault(graph)
        if fault is not None:
            proofs.insert(0, fault)
        return Result(proofs, graph, scans, self.cuts)

    def _firsts(self) -> Iterable[tuple[int, int]]:
        """Yield for each check the numbers of its first watched and its first tested formula."""
        watched, tested = 0, sum(len(c.watched) for c in self.checks)
        for check in self.checks:
            yield watched, tested
            watched, tested = watched + len(check.watched), tested + len(check.tested)

    def _judge(self, graph: StateGraph, limits: Limits, entry: Property, check: Check, first: int,
               first_tested: int) -> Proof:
        watch, loop = self.loop.watch, self.loop
        evidence = Evidence(loop, graph, first, first_tested,
                            lambda n, s: bool(watch(s.memory, loop.facts(s.plant)) >> n & 1),
                            limits)
        finding = check.judge(evidence)
        watched = None if finding.watched is None else first + finding.watched
        path = None
        if finding.run is not None:
            path = self._path(graph, finding.run, watched, finding.decided)
            if finding.decided is not None and path.times is not None:
                _let_the_monitor_decide(path, entry)
        return Proof(entry.name, str(entry.formula), entry.description, finding, path,
                     self._by_initial(graph, finding), len(graph), graph.seconds)

    def _path(self, graph: StateGraph, run: Lasso, watched: int | None = None,
              decided: tuple[int | None, int] | None = None) -> Path:
        of = timed_path_of if isinstance(self.loop, TimedLoop) else path_of
        return of(self.loop, graph, self.predicates, run, watched, self.cycle_ns, decided)

    def _by_initial(self, graph: StateGraph, finding: Finding) -> dict[str, str]:
        """Return the verdict for each initial state: violated where a bad state can be reached."""
        if len(self.loop.origins) < 2 or not graph.complete:
            return {}
        name_of = self.loop.plant.name_of
        if finding.violated_from is not None:
            return {name_of(origin): VIOLATED if origin in finding.violated_from else HOLDS
                    for origin, _ in self.loop.starts(graph.number)}
        if finding.bad is None:
            return {}
        reached = backwards(graph, finding.bad) if finding.bad else set()
        return {name_of(origin): VIOLATED if n in reached else HOLDS
                for origin, n in self.loop.starts(graph.number)}

    def _fault(self, graph: StateGraph) -> Proof | None:
        """Return the violated demand that the program does not fault, if it does."""
        at = next((n for n, s in enumerate(graph.states) if s.fault), None)
        if at is None:
            return None
        run = Lasso(*run_to(graph, at), [])
        path = self._path(graph, run)
        finding = Finding(VIOLATED, run=run, bad={n for n, s in enumerate(graph.states)
                                                  if s.fault})
        return Proof(NO_FAULT, "the program never faults", "", finding, path,
                     self._by_initial(graph, finding), len(graph), graph.seconds)


def _let_the_monitor_decide(path: Path, entry: Property) -> None:
    """Take the instant of a violation from the path's real scans, which come later than the
    model's, where scans take no time."""
    try:
        suite = Suite([entry], path.predicates.tags)
    except CompileError:
        return
    for frame in path.trace().frames:
        suite.observe(frame)
    due_ns = suite.next_deadline_ns()
    if due_ns is not None:
        suite.advance(due_ns)
    result, = suite.results()
    if result.failed and result.decided_at_ns is not None:
        path.decided_ns += result.decided_at_ns - path.ends_at_ns


def _check(formula: Formula, plant: Abstraction, merge: Merge) -> Check:
    """Return the check of a formula, or why it cannot be judged of this loop."""
    known = {f"plant.{f.name}".casefold() for f in plant.facts}
    lacks = [r.name for r in tag_refs(formula)
             if r.name.casefold().startswith("plant.") and r.name.casefold() not in known]
    if lacks:
        return NoCheck(f"the finite plant does not know {', '.join(lacks)}")
    check = check_for(formula)
    reason = check.unfit_for(merge)
    return NoCheck(reason) if reason else check


def _never_written(program: Program, inputs: Sequence[Point],
                   kept: frozenset[int] | None) -> list[str]:
    """Return, in words, which inputs of the program nothing writes in any run."""
    driven = {place_of(program, point) for point in inputs}
    tags = {slot.offset: slot.tag for slot in reversed(program.layout.slots)
            if slot.tag.address.startswith("%I") and slot.offset not in driven
            and (kept is None or slot.offset in kept)}
    names = [f"{tag.name} ({tag.address})" for _, tag in sorted(tags.items())]
    return [f"nothing writes the inputs {', '.join(names)}: they stay as at the start"] \
        if names else []


__all__ = ["HOLDS", "INCONCLUSIVE", "VIOLATED", "Proof", "Prover", "Result"]
