"""SPIN as an independent judge: `spin -a`, the C compiler and `pan` on a model, and their verdicts.

A counterexample of SPIN is read back from its trail, executed again by our own closed loop, and
looked at there: one that does not violate is an error, never a verdict. A search that reaches a
limit is inconclusive.

Source: G. J. Holzmann, The SPIN Model Checker, Addison-Wesley 2003, and the manual pages of spin
and pan.
"""

from __future__ import annotations

import os
import re
import resource
import shutil
import subprocess
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path as File
from typing import Any, NamedTuple

from plcemu.base.errors import PlcemuError
from plcemu.verify.check import HOLDS, INCONCLUSIVE, VIOLATED
from plcemu.verify.explore import Graph, Limits
from plcemu.verify.fair import Lasso, Step
from plcemu.verify.loop import ClosedLoop, State
from plcemu.verify.path import Path, path_of
from plcemu.verify.promela.claims import holds_on
from plcemu.verify.promela.model import PromelaModel, Question, claim_of, nfair
from plcemu.verify.promela.plant import REST, Begin, Move
from plcemu.verify.prove import Prover

DEPTHS = (10_000, 1_000_000, 20_000_000)
"""How deep SPIN searches, one after the other, until the search is whole."""

SECONDS = 600.0
"""How long one search may take where the configuration sets no limit."""

_START_OF_CYCLE = "<<<<<START OF CYCLE>>>>>"


class SpinError(PlcemuError):
    """SPIN is not there, or it or the compiler does not take the model."""


class _TooLong(SpinError):
    """A command took longer than it may."""


@dataclass(slots=True)
class Answer:
    """What SPIN says to a question.

    Attributes:
        question: asked.
        verdict: `holds`, `violated` or `inconclusive`.
        reason: why it is inconclusive; else empty.
        path: what SPIN found, executed again by our closed loop; None if it found nothing.
    """

    question: Question
    verdict: str
    reason: str = ""
    path: Path | None = None


@dataclass(slots=True)
class Costs:
    """What SPIN's chain took.

    Attributes:
        seconds: of the processor for `spin -a`, the compiler, and all searches together.
        wall: the same by the clock.
        searches: how often `pan` was run.
        states: how many states it stored in all of them.
        transitions: how many transitions it made.
    """

    seconds: dict[str, float] = field(default_factory=dict)
    wall: dict[str, float] = field(default_factory=dict)
    searches: int = 0
    states: int = 0
    transitions: int = 0


class Found(NamedTuple):
    """How a search ended.

    Attributes:
        reason: the limit that was reached; empty if the search is whole.
        question: the number of the question whose error was found; None if none was.
        moves: the moves that lead to the error.
        cycle: those repeated for ever after them, if that is the error.
        early: whether a formula is violated however the run goes on.
    """

    reason: str = ""
    question: int | None = None
    moves: tuple[Move, ...] = ()
    cycle: tuple[Move, ...] = ()
    early: bool = False


class Spin:
    """A model compiled by SPIN, ready to be searched.

    Args:
        model: it.
        folder: an empty folder for SPIN's files.
        limits: of time and memory for one search.

    Raises:
        SpinError: `spin` or the C compiler is missing, or does not take the model.
    """

    def __init__(self, model: PromelaModel, folder: File, limits: Limits = Limits()) -> None:  # noqa: B008
        self.model, self.folder, self.limits = model, folder, limits
        self.costs = Costs()
        self._again = [n for n, q in enumerate(model.questions)
                       if q.kind == "again" and not q.why_not]
        model.write(folder / "model.pml")
        spin, compiler = tool("spin"), tool("gcc", "cc")
        self._run("spin", [spin, "-a", "model.pml"])
        options = [f"-DNFAIR={nfair(model.processes)}"] if self._again else ["-DSAFETY"]
        if limits.memory_mb is not None:
            options.append(f"-DMEMLIM={limits.memory_mb}")
        self._run("compiler", [compiler, "-O2", "-w", "-fwrapv", "-DNOREDUCE", *options,
                               "-o", "pan", "pan.c"])

    def _run(self, what: str, command: Sequence[str], environment: dict[str, str] | None = None,
             may_fail: bool = False) -> str:
        """Run a command in the folder; return what it prints, and note what it took."""
        before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
        timeout = SECONDS if self.limits.seconds is None else self.limits.seconds
        try:
            done = subprocess.run(command, cwd=self.folder, capture_output=True, text=True,
                                  errors="replace", timeout=timeout, check=False,
                                  env={**os.environ, **(environment or {})})
        except subprocess.TimeoutExpired:
            raise _TooLong(f"SPIN's limit of {timeout:g} s was reached ({what})") from None
        after, costs = resource.getrusage(resource.RUSAGE_CHILDREN), self.costs
        used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        costs.seconds[what] = costs.seconds.get(what, 0.0) + used
        costs.wall[what] = costs.wall.get(what, 0.0) + time.monotonic() - begin
        output = done.stdout + done.stderr
        if done.returncode and not may_fail:
            raise SpinError(f"{command[0]} does not take the model: {output.strip()[:2000]}")
        return output

    # ------------------------------------------------------------ searching

    def search(self, asked: Sequence[int], claim: int | None = None,
               start: int | None = None) -> Found:
        """Search for an error.

        Args:
            asked: the numbers of the questions whose assertions count.
            claim: the number of the question whose LTL formula is judged besides.
            start: the number of the plant's initial state to begin in; all if None.

        Raises:
            SpinError: the model is wrong, or its tables lack something.
        """
        environment = {"PLCEMU_ASKED": "".join(f",{n}" for n in asked) + ","}
        if start is not None:
            environment["PLCEMU_START"] = str(start)
        for depth in DEPTHS:
            options = self._options(claim, depth)
            (self.folder / "model.pml.trail").unlink(missing_ok=True)
            try:
                output = self._run("pan", ["./pan", *options], environment, may_fail=True)
            except _TooLong as limit:
                return Found(str(limit))
            self.costs.searches += 1
            errors = re.search(r"errors: (\d+)", output)
            self.costs.states += _number(r"(\d+) states, stored", output)
            self.costs.transitions += _number(r"(\d+) transitions", output)
            if errors is None:
                raise SpinError(f"pan ends without a verdict: {output.strip()[:2000]}")
            if errors[1] != "0":
                return self._replay(options, environment, claim)
            if "max search depth too small" not in output:
                break
        else:
            return Found(f"SPIN's limit of {DEPTHS[-1]:,} steps was reached")
        if "-DMEMLIM bound" in output or "out of memory" in output:
            return Found(f"SPIN's limit of {self.limits.memory_mb} MB was reached")
        if "Search not completed" in output:
            return Found("SPIN did not complete its search")
        return Found()

    def _options(self, claim: int | None, depth: int) -> list[str]:
        options = [f"-m{depth}", f"-w{self._hash_bits()}"]
        if not self._again:
            return [*options, "-E"]
        if len(self._again) > 1:
            options += ["-N", claim_of(self._again[0] if claim is None else claim)]
        if claim is None:
            return options
        return [*options, "-a", *(["-f"] if self.model.tables.names else [])]

    def _hash_bits(self) -> int:
        """Return how large SPIN's table of states is made, as a power of two."""
        return max(16, min(26, len(self.model.tables.moves).bit_length() + 2))

    def _replay(self, options: Sequence[str], environment: dict[str, str],
                claim: int | None) -> Found:
        """Read the trail back: what was moved, and what was found in the end."""
        claimed = list(options[options.index("-N"):options.index("-N") + 2]) \
            if "-N" in options else []
        output = self._run("pan -r", ["./pan", "-r", *options[:2], *claimed], environment,
                           may_fail=True)
        steps: list[list[Move]] = [[]]
        for line in output.splitlines():
            move = re.fullmatch(r"\s*move (\d+)", line)
            if move:
                steps[-1].append(self.model.tables.moves[int(move[1])])
            elif _START_OF_CYCLE in line:
                steps.append([])
        if re.search(r"^\s*unknown$", output, re.M):
            raise SpinError("the tables of the finite plant lack an answer that SPIN asks for; was "
                            "it explored completely?")
        if re.search(r"^\s*unsettled$", output, re.M):
            raise SpinError("the loop does not settle in SPIN's model")
        found = re.search(r"^\s*found (\d+)$", output, re.M)
        if found is None and claim is None:
            raise SpinError(f"SPIN's trail cannot be read: {output.strip()[-2000:]}")
        return Found("", int(found[1]) if found else claim, tuple(steps[0]),
                     tuple(steps[1]) if len(steps) > 1 and not found else (),
                     found is None and len(steps) == 1)

    # ------------------------------------------------------------ judging

    def judge(self, prover: Prover, start: int | None = None) -> list[Answer]:
        """Ask everything; one search for all assertions and a claim, more only after an error.

        Args:
            prover: whose loop the model is of; it executes what SPIN finds again.
            start: the number of the plant's initial state to begin in; all if None.
        """
        questions = self.model.questions
        open_ = [n for n, q in enumerate(questions) if not q.why_not and q.kind != "again"]
        answers: dict[int, Answer] = {n: Answer(q, INCONCLUSIVE, q.why_not)
                                      for n, q in enumerate(questions) if q.why_not}
        for claim in (*self._again, None):
            if claim is None and answers.keys() >= set(open_):
                break
            while True:
                found = self.search(open_, claim, start)
                if found.question is None:
                    self._close(answers, open_, claim, found.reason)
                    break
                number = found.question
                answers[number] = self._error(prover, questions[number], found)
                if number == claim:
                    break
                open_.remove(number)
        return [answers[n] for n in sorted(answers)]

    def _close(self, answers: dict[int, Answer], open_: list[int], claim: int | None,
               reason: str) -> None:
        """Note that a search found no error, for all that it looked for."""
        for n in [*open_, *([] if claim is None else [claim])]:
            question = self.model.questions[n]
            verdict = INCONCLUSIVE if reason else VIOLATED if question.holds_if_found else HOLDS
            answers[n] = Answer(question, verdict, reason)

    def _error(self, prover: Prover, question: Question, found: Found) -> Answer:
        path = replayed(prover, self.model, question, found)
        return Answer(question, HOLDS if question.holds_if_found else VIOLATED, "", path)


def _number(pattern: str, output: str) -> int:
    found = re.search(pattern, output)
    return int(found[1]) if found else 0


def tool(*names: str) -> str:
    """Return the path of a program; raises SpinError if none of the names is one."""
    for name in names:
        path = shutil.which(name)
        if path is not None:
            return path
    raise SpinError(f"{' or '.join(names)} is not installed; on Debian: apt install spin gcc "
                    "libc6-dev")


# ---------------------------------------------------------------- what SPIN found, once more


def replayed(prover: Prover, model: PromelaModel, question: Question, found: Found) -> Path:
    """Execute what SPIN found by our own closed loop, and look whether it shows what it should.

    Raises:
        SpinError: it does not; then SPIN's model or our loop is wrong.
    """
    loop, moves = prover.loop, found.moves
    if not moves or not isinstance(moves[0].action, Begin):
        raise SpinError(f"{question.name}: SPIN's trail does not begin in an initial state")
    states: list[State] = [loop.settled_from(moves[0].action.plant)]
    stem = [_step(model, loop, states, move) for move in moves[1:] if move.action is not REST]
    start = len(states) - 1
    cycle = [_step(model, loop, states, move) for move in found.cycle if move.action is not REST]
    if cycle and _lasting(states[-1]) != _lasting(states[start]):
        raise SpinError(f"{question.name}: SPIN's cycle does not come back to where it began")
    run = Lasso(0, stem, cycle)
    trouble = _flaw(prover, question, states, run, found.early)
    if trouble:
        raise SpinError(f"{question.name}: SPIN's counterexample is none: {trouble}")
    graph: Graph[State, Any] = Graph(states=states)
    loop.origins.setdefault(states[0], moves[0].action.plant)
    return path_of(loop, graph, prover.predicates, run, _watched(prover, question),
                   prover.cycle_ns, (None, 0) if found.early else None)


def _step(model: PromelaModel, loop: Any, states: list[State], move: Move) -> Step:
    here = states[-1]
    if here.plant != model.tables.states[move.source]:
        raise SpinError("SPIN's trail goes where our closed loop does not")
    states.append(loop.next(here, move.action))
    return Step(move.action, len(states) - 1)


def _lasting(state: State) -> tuple[Any, ...]:
    return state.memory, state.plant, state.fault


def _watched(prover: Prover, question: Question) -> int | None:
    """Return the number of the watched formula that is seen in a run's last step."""
    if question.kind != "seen":
        return None
    names = [p.name for p in prover.properties]
    return sum(len(c.watched) for c in prover.checks[:names.index(question.name)])


def _flaw(prover: Prover, question: Question, states: list[State], run: Lasso,
          early: bool) -> str:
    """Return why a run does not show what it should; empty if it does."""
    loop, last = prover.loop, states[-1]
    if question.kind == "fault":
        return "" if last.fault else "the program does not fault"
    if question.kind == "rest":
        return "something can still happen" if loop.actions(last) else ""
    letters = _letters(prover, question, states, run)
    if question.kind == "seen":
        return "" if any(letter[0] for letter in letters[-1]) else "it is not seen in the last step"
    return _shows(question, letters, run) or ("" if early else _unfair(loop, states, run))


def _letters(prover: Prover, question: Question, states: Sequence[State],
             run: Lasso) -> list[list[list[bool]]]:
    """Return for each step and each of its scans which of the question's formulas hold."""
    loop, tests = prover.loop, [prover.predicates.test(f) for f in question.formulas]
    trails = [loop.first_scans(loop.origins[states[0]])]
    trails += [loop.scans(states[n], step.action)
               for n, step in enumerate([*run.stem, *run.cycle])]
    return [[[test(memory, loop.facts(plant)) for test in tests]
             for memory, plant in scans or [(state.memory, state.plant)]]
            for (scans, _, _), state in zip(trails, states, strict=True)]


def _shows(question: Question, letters: Sequence[Sequence[Sequence[bool]]], run: Lasso) -> str:
    """Return why what is seen on a run without end does not violate; empty if it does."""
    if question.linear is not None:
        every = [letter for scans in letters for letter in scans]
        back = min(1 + len(run.stem) if run.cycle else len(every), len(every) - 1)
        holds = holds_on(question.linear, question.formulas, every, back)
        return "the formula holds on it" if holds else ""
    # Each must be seen in the cycle, or where nothing happens any more, in the last scan.
    lasting = [letter for scans in letters[1 + len(run.stem):] for letter in scans] \
        if run.cycle else [[letter for scans in letters for letter in scans][-1]]
    return "everything is seen again and again" if all(map(any, zip(*lasting, strict=True))) else ""


def _unfair(loop: ClosedLoop, states: Sequence[State], run: Lasso) -> str:
    """Return why a run is not fair; empty if it is."""
    if not run.cycle:
        owed = loop.merge == "none" or (loop.fairness != "none" and loop.pending(states[-1]))
        return "it cannot stay where it stays" if loop.actions(states[-1]) and owed else ""
    steps = [(states[n], step.action) for n, step in enumerate(run.cycle, len(run.stem))]
    owed_always = set.intersection(*(
        set(loop.pending(state)) - set(loop.done(action)) for state, action in steps))
    return f"{min(owed_always)} is pending for ever" \
        if owed_always and loop.fairness != "none" else ""
