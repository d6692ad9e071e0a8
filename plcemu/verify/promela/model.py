"""The closed loop as a Promela model, so that SPIN can judge what our own checker has judged.

The program is translated from its compiled code (`code`), not from the states that our
checker found: SPIN executes the scans itself. The finite plant comes as tables
(`plant`). A step of the model is a step of `plcemu.verify.loop`: something happens in the
plant, then scans follow until program and plant rest (`merge: stable`), or one scan
(`merge: none`). What must never be seen in a scan is an assertion there; what must be seen again
and again is noted in a bit for each step, of which an LTL formula speaks.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from plcemu.base.errors import PlcemuError
from plcemu.monitor.formula import Formula
from plcemu.verify.check import Check, Invariant, NoDeadlock, Reachable, Recurrence, StateGraph
from plcemu.verify.cone import cone_of
from plcemu.verify.ltl.check import Linear
from plcemu.verify.machine import place_of
from plcemu.verify.promela.claims import ATOM, ltl_of
from plcemu.verify.promela.code import Cell, Cells, NoPromela, ScanWriter
from plcemu.verify.promela.formula import FormulaWriter
from plcemu.verify.promela.plant import FREE, PlantTables, RecordedPlant
from plcemu.verify.prove import NO_FAULT, Prover
from plcemu.verify.settle import SETTLES_WITHIN

_COMPILER = "gcc -O2 -fwrapv -DNOREDUCE"

Kind = Literal["seen", "again", "rest", "fault"]


@dataclass(slots=True)
class Question:
    """What SPIN is asked.

    Attributes:
        name: of the property.
        kind: whether `formulas` are ever seen in a scan, are seen again and again, whether the
            loop ever comes to rest for good, or whether the program ever faults.
        formulas: state formulas.
        texts: they in Promela.
        claim: what must hold of all runs, in SPIN's words over `atom_0`, the first formula, ...
        linear: the formula of LTL that it says; None of `G F p & G F q`.
        why_not: why SPIN cannot be asked; else empty.
        holds_if_found: whether what is looked for is wanted (`EF p`).
    """

    name: str
    kind: Kind
    formulas: tuple[Formula, ...] = ()
    texts: tuple[str, ...] = ()
    claim: str = ""
    linear: Formula | None = None
    why_not: str = ""
    holds_if_found: bool = False


def question_of(name: str, check: Check, stable: bool) -> Question:
    """Return what SPIN is asked for a check, where scans are merged (`stable`) or not."""
    if isinstance(check, Invariant):
        return Question(name, "seen", check.watched)
    if isinstance(check, Reachable):
        return Question(name, "seen", check.watched, holds_if_found=True)
    if isinstance(check, Recurrence):
        claim = " && ".join(f"([] <> {ATOM}{n})" for n in range(len(check.wanted)))
        return Question(name, "again", check.wanted, claim=claim)
    if isinstance(check, NoDeadlock):
        return Question(name, "rest")
    if isinstance(check, Linear) and not stable:
        return _linear(name, check.formula)
    return Question(name, "seen", why_not="SPIN is asked for G p, AG p, EF p, G F p & G F q, "
                    "AG EX TRUE, and where every scan is a state (merge: none) for LTL")


def _linear(name: str, formula: Formula) -> Question:
    """Return what SPIN is asked for a formula of LTL; nothing has begun before the first step."""
    atoms: list[Formula] = []
    try:
        claim = ltl_of(formula, atoms)
    except NoPromela as problem:
        return Question(name, "again", why_not=str(problem))
    return Question(name, "again", tuple(atoms), claim=claim, linear=formula)


class PromelaModel:
    """A model, and what is needed to run it and to read what it says.

    Args:
        prover: what is to be proved; its plant must be a `RecordedPlant`.
        graph: the closed loop as it was explored; only the plant's states are taken from it.
        title: what the model is of, for its head.
        header_name: of the file with the plant's tables, which the model includes.

    Raises:
        NoPromela: the program or the plant cannot be said in Promela; with place and reason.

    Attributes:
        questions: what is asked; the number of each is its place.
        tables: the plant.
        text: the model, which includes `header_name`.
        header: the plant's tables, in C.
        processes: how many processes do something, for SPIN's fairness.
    """

    def __init__(self, prover: Prover, graph: StateGraph, title: str,
                 header_name: str = "plant.h") -> None:
        loop, program = prover.loop, prover.loop.machine.resource.program
        assert isinstance(loop.plant, RecordedPlant)
        self.loop, self.stable = loop, loop.merge == "stable"
        self._title, self._header_name = title, header_name
        places = [(p, place_of(program, p)) for p in loop.outputs]
        self._outputs = [(p, at) for p, at in places if at is not None]
        self.tables = PlantTables(loop.plant, [p for p, _ in self._outputs], not self.stable,
                                  loop.fairness != "none", {state.plant for state in graph.states})
        self.questions = [Question(NO_FAULT, "fault"),
                          *(question_of(p.name, c, self.stable) for p, c in
                            zip(prover.properties, prover.checks, strict=True))]
        asked = [f for q in self.questions for f in q.formulas]
        frozen = [prover.frozen] if prover.frozen is not None else []
        kept = cone_of(program, prover.predicates.bytes_of([*asked, *frozen]) | {
            b for p, at in self._outputs for b in range(at, at + p.width)})
        self.cells = Cells(program, kept)
        clocks = [c for c in program.layout.clocks
                  if c.observed and self.cells.matters(c.offset)]
        if clocks:
            raise NoPromela("the program measures time, and the model has none")
        self._formulas = FormulaWriter(prover.predicates, self.cells, self._whole(prover))
        self._ask()
        self._frozen = self._formulas.write(frozen[0]) if frozen else ""
        if frozen and self.tables.names:
            raise NoPromela("a plant of which fairness demands something is at times frozen")
        resource = loop.machine.resource
        runs = [(i.function, i.base) for t in resource.tasks
                for i in map(program.instance, t.programs)]
        self._code = ScanWriter(program, self.cells, resource.engine.prepare(runs).budget)
        self._code.write(runs)
        self._inputs = self._latched()
        self.header = self.tables.text(title, self._readings(), self._facts())
        self.processes = len(self.tables.names) + 1
        self.text = "\n".join(self._lines()) + "\n"

    def write(self, file: Path) -> Path:
        """Write the model to a file, and the plant's tables beside it; return where these are.

        Raises:
            PlcemuError: a file cannot be written.
        """
        header = file.with_name(self._header_name)
        try:
            file.write_text(self.text, encoding="utf-8")
            header.write_text(self.header, encoding="utf-8")
        except OSError as problem:
            raise PlcemuError(f"{problem.filename}: {problem.strerror}") from None
        return header

    # ------------------------------------------------------------ what is asked, and of what

    def _ask(self) -> None:
        for question in self.questions:
            if question.kind == "again" and self.loop.fairness == "strong" \
                    and not question.why_not:
                question.why_not = "SPIN knows weak fairness, not strong"
            try:
                question.texts = tuple(self._formulas.write(f) for f in question.formulas)
            except NoPromela as problem:
                question.why_not = question.why_not or str(problem)

    def _whole(self, prover: Prover) -> list[tuple[int, int] | None]:
        """Return the least and the largest value of each fact, if they are whole numbers."""
        limits: list[tuple[int, int] | None] = []
        for column in zip(*(prover.loop.facts(s) for s in self.tables.states[1:]), strict=True):
            whole = all(isinstance(v, int) and abs(v) < 1 << 31 for v in column)
            limits.append((int(min(column)), int(max(column))) if whole else None)
        return limits

    def _latched(self) -> list[tuple[str, str]]:
        """Return the variables that read inputs, with the input's name, in order of columns."""
        program = self.loop.machine.resource.program
        by_offset = {cell.offset: cell for cell in self.cells}
        self._columns = [(p, by_offset[at]) for p in self.loop.inputs
                         if (at := place_of(program, p)) in by_offset]
        for point, cell in self._columns:
            if {"bool": 0, "u8": 1, "i8": 1, "u16": 2, "i16": 2}.get(cell.machine, 4) != (
                    0 if point.is_bit else point.width):
                raise NoPromela(f"{point.name} at {point.address} is of type {cell.machine}")
        return [(cell.name, point.name) for point, cell in self._columns]

    def _readings(self) -> list[list[int]]:
        rows = []
        for state in self.tables.states[1:]:
            raw = self.loop.raw_inputs(state)
            rows.append([_held(raw[p.name], 8 * p.width, cell.machine)
                         for p, cell in self._columns])
        return rows

    def _facts(self) -> list[list[int]]:
        rows = [self.loop.facts(state) for state in self.tables.states[1:]]
        return [[int(row[n]) for n in self._formulas.facts] for row in rows]

    # ------------------------------------------------------------ the model's text

    def _lines(self) -> Iterator[str]:
        yield from self._head()
        yield from self._declarations()
        yield from self._process()
        yield "init {"
        yield "  atomic {"
        yield "    c_code { plant_prepare(); };"
        for n in range(self.processes):
            who = "what no fairness demands" if n == FREE else self.tables.names[n - 1]
            yield f"    run event({n});{'' if n else '  '}  /* {who} */"
        yield "  }"
        yield "}"
        for number, question in enumerate(self.questions):
            if question.kind == "again" and not question.why_not:
                told = question.claim.replace(ATOM, f"seen_{number}_")
                yield f"\nltl {claim_of(number)} {{ {told} }}  /* {question.name} */"

    def _head(self) -> Iterator[str]:
        fair = " -f" if self.tables.names else ""
        yield f"/* {self._title}"
        yield " *"
        yield " * Made by plcemu from the compiled program; the plant's tables are in"
        yield f" * {self._header_name}. What is seen in a scan is an assertion:"
        yield " *   spin -a MODEL"
        yield f" *   {_COMPILER} -DSAFETY -DNOCLAIM -o pan pan.c && ./pan -E"
        claims = [n for n, q in enumerate(self.questions) if q.kind == "again" and not q.why_not]
        if claims:
            yield " * What is demanded again and again is a formula:"
            yield f" *   {_COMPILER} -DNFAIR={nfair(self.processes)} -o pan pan.c"
        for number in claims:
            name = f" -N {claim_of(number)}" if len(claims) > 1 else ""
            yield f" *   PLCEMU_ASKED= ./pan -a{fair}{name}   # {self.questions[number].name}"
        yield " * PLCEMU_START=n begins in the n-th initial state only; PLCEMU_ASKED=,1,2, asks for"
        yield " * these alone:"
        for number, question in enumerate(self.questions):
            if question.kind != "again":
                why = f" - not asked: {question.why_not}" if question.why_not else ""
                yield f" *   {number}: {question.name}{why}".replace("*/", "* /")
        yield " */"

    def _declarations(self) -> Iterator[str]:
        yield "c_decl {"
        yield f'  \\#include "{self._header_name}"'
        yield "}"
        yield "#define reads(column) c_expr { plant_readings[plant_states[now.plant][0]][column] }"
        yield "#define fact(column) c_expr { plant_facts[plant_states[now.plant][1]][column] }"
        yield "#define begun (plant != 0)"
        yield '#define asked(number) c_expr { (plant_is_asked)("," #number ",") }'
        yield ""
        yield "int plant;    /* the plant's state; 0 before the start */"
        yield "int choice;   /* which of several moves is made */"
        yield "short fault;  /* why the program has stopped; 0 while it runs */"
        if self.tables.mixed:
            yield "bit may;      /* whether what no fairness demands may happen next */"
        for number, question in enumerate(self.questions):
            if question.kind == "again" and not question.why_not:
                for n, formula in enumerate(question.formulas):
                    yield f"bit seen_{number}_{n};  /* in the last step: {formula} */"
        yield ""
        yield "/* the program's memory */"
        for cell in self.cells:
            yield cell.declaration
        yield ""
        yield "/* used within one step only */"
        yield "hidden int before_plant, after_plant, made, scans;"
        for n in range(len(self._words())):
            yield f"hidden int word_{n};"
        for cell in self._kept():
            declared = cell.declared(f"before_{cell.name}")
            yield f"hidden {declared.replace('bit ', 'byte ')};"  # SPIN hides no bits
        for n in range(self._code.spares):
            yield f"hidden int spare_{n};"
        for n in range(self._code.locals):
            yield f"hidden int local_{n};"
        if self._code.loops:
            yield "hidden int budget_left;"
        yield ""

    def _kept(self) -> list[Cell]:
        """Return the variables of which the values before a scan are kept."""
        if not self.stable and not self._code.faults:
            return []
        inputs = {cell.offset for _, cell in self._columns}
        return [c for c in self.cells if c.offset in self.cells.written | inputs]

    def _process(self) -> Iterator[str]:
        yield "/* A process for each name that fairness speaks of, and one for the rest."
        yield " * Something happens in the plant, then scans follow, all in one step. */"
        yield "proctype event(byte who) {"
        yield "  do"
        yield "  :: atomic {"
        yield f"       {self._enabled()} ->"
        yield "       choice = 0;"
        yield "       do"
        yield f"       :: {self._more()} -> choice++"
        yield "       :: break"
        yield "       od; skip;"
        yield "       d_step {"
        for line in self._step():
            yield "         " + line
        yield "       }"
        if self.tables.mixed:
            yield "       if :: c_expr { (plant_named)(now.plant) } -> may = 1 :: may = 0 fi"
        yield "     }"
        yield "  od"
        yield "}"
        yield ""

    def _enabled(self) -> str:
        can = "c_expr { (plant_choices)(now.plant, Pevent->who) > 0 }"
        if self.tables.mixed:
            can += " && (who != 0 || may || !c_expr { (plant_named)(now.plant) })"
        return f"((fault -> who == 0 : {can}))"

    def _more(self) -> str:
        more = "!fault && c_expr { (plant_choices)(now.plant, Pevent->who) > now.choice + 1 }"
        return f"{more} && !(plant != 0 && {self._frozen})" if self._frozen else more

    def _step(self) -> Iterator[str]:
        for number, question in enumerate(self.questions):
            if question.kind == "again" and not question.why_not:
                for n in range(len(question.texts)):
                    yield f"seen_{number}_{n} = 0;"
        yield "scans = 0;"
        yield "if"
        yield ":: fault ->"
        yield "  choice = 0;"
        for line in self._noted():
            yield "  " + line
        yield "  goto done"
        yield ":: else ->"
        yield "  made = c_expr { (plant_move)(now.plant, Pevent->who, now.choice) };"
        yield '  printf("move %d\\n", made);'
        yield "  plant = c_expr { plant_moves[made][1] };"
        yield "  choice = 0;"
        yield f"  {_lacks('plant < 0')}"
        yield "fi;"
        yield "scan: skip;"
        for cell in self._kept():
            yield f"before_{cell.name} = {cell.name};"
        for n, (name, point) in enumerate(self._inputs):
            yield f"{name} = reads({n});  /* {point} */"
        if self._code.loops:
            yield f"budget_left = {self._code.budget};"
        yield "/* ---- the program ---- */"
        yield from self._code.lines
        yield "/* ---- the end of the scan ---- */"
        yield "scanned: skip;"
        yield from self._stopped()
        yield from self._judged()
        yield from self._follow()
        yield "done: skip;"
        for number in (n for n, q in enumerate(self.questions) if q.kind == "rest"):
            yield (f"if :: (fault || c_expr {{ (plant_rests)(now.plant) }}) && asked({number}) -> "
                   f'printf("found {number}\\n"); assert(false) :: else fi;')
        yield "before_plant = 0"

    def _stopped(self) -> Iterator[str]:
        """Write what follows a fault: memory is as before the scan."""
        if not self._code.faults:
            return
        yield "if"
        yield ":: fault ->"
        for n, reason in enumerate(self._code.faults):
            yield f"  /* {n + 1}: {reason.replace('*/', '* /')} */"
        for cell in self._kept():
            yield f"  {cell.name} = before_{cell.name};"
        if not self.stable:  # the scan that faulted is a state of its own all the same
            for line in self._noted():
                yield "  " + line
        yield '  if :: asked(0) -> printf("found 0\\n"); assert(false) :: else fi;'
        yield "  goto done"
        yield ":: else"
        yield "fi;"

    def _judged(self) -> Iterator[str]:
        for number, question in enumerate(self.questions):
            if question.why_not:
                continue
            if question.kind == "seen":
                yield f"/* {question.name} */"
                yield (f"if :: {question.texts[0]} && asked({number}) -> "
                       f'printf("found {number}\\n"); assert(false) :: else fi;')
        yield from self._noted()

    def _noted(self) -> Iterator[str]:
        """Write the bits of what is seen in a scan, or holds where nothing happens any more."""
        for number, question in enumerate(self.questions):
            if question.kind == "again" and not question.why_not:
                for n, text in enumerate(question.texts):
                    yield f"seen_{number}_{n} = seen_{number}_{n} || {text};"

    def _words(self) -> list[str]:
        """Return the outputs as the words by which the plant's tables know them."""
        words: list[list[str]] = [[]]
        for (point, at), (word, shift) in zip(self._outputs, self.tables.words, strict=True):
            while len(words) <= word:
                words.append([])
            bits = 1 if point.is_bit else 8 * point.width
            cell = next(c for c in self.cells if c.offset == at)
            text = cell.name if bits in (1, 32) else f"({cell.name} & {(1 << bits) - 1})"
            words[word].append(f"({text} << {shift})" if shift else text)
        return [" | ".join(word) or "0" for word in words]

    def _follow(self) -> Iterator[str]:
        """Write how the plant follows its outputs, and whether the loop goes on."""
        words = self._words()
        for n, word in enumerate(words):
            yield f"word_{n} = {word};"
        arguments = "".join(f", word_{n}" for n in range(len(words)))
        yield f"after_plant = c_expr {{ (plant_follow)(now.plant{arguments}) }};"
        yield _lacks("after_plant < 0")
        if not self.stable:
            yield "plant = after_plant;"
            return
        yield "before_plant = plant;"
        yield "plant = after_plant;"
        yield "scans++;"
        yield "if"
        yield ":: (plant == before_plant"
        for cell in self._kept():
            yield f"   && {cell.name} == before_{cell.name}"
        yield "   ) -> skip"
        yield f":: else -> if :: scans < {SETTLES_WITHIN} -> goto scan"
        yield '           :: else -> printf("unsettled\\n"); assert(false) fi'
        yield "fi;"


def _lacks(condition: str) -> str:
    """Write the error that the plant's tables lack what is asked of them."""
    return f'if :: {condition} -> printf("unknown\\n"); assert(false) :: else fi;'


def _held(raw: int, bits: int, machine: str) -> int:
    """Return a raw reading as the variable holds it."""
    signed = machine[0] == "i" or machine == "u32"
    return raw - (1 << bits) if signed and raw >> bits - 1 else raw


def claim_of(number: int) -> str:
    """Return the name of a question's LTL formula."""
    return f"question_{number}"


def nfair(processes: int) -> int:
    """Return what SPIN calls NFAIR: a quarter of the processes, init and the claim among them."""
    return max(2, (processes + 3) // 4 + 1)
