"""A scan by the engines beside the same rungs in C, built with gcc -O2: two programs, one run.

`bool` is 1,000 Boolean IL instructions. `mixed` is 50 TON, 50 CTU and integer arithmetic, 650 IL
instructions; its timers restart themselves, so that all of it stays busy. The C program is made of
the same list of rungs, its timers and counters written by hand, and must compute the same. In every
round each way runs once, one after the other; of all rounds the fastest counts, since other work on
the machine only adds.

    python benchmarks/scan_cost.py [--rounds N] [--json]
"""

from __future__ import annotations

import argparse
import ctypes
import json
import random
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from plcemu.engine.engines import Engine, make_engine
from plcemu.ir.program import Program
from plcemu.lang.compile import compile_program

STEP_NS = 10_000_000
UNITS = 50
PROMISED = {"bool": (1.5, 3.0, 150.0), "mixed": (1.5, 4.0, 150.0)}
"""By program: times C in many scans, us of a single one, ms from source to the first scan's end."""

Rung = tuple[list[tuple[str, bool, int]], int]
"""Operators with negation and operand, and where the result goes; numbers are variables'."""


@dataclass(frozen=True)
class Case:
    """A program as IL and as C.

    Attributes:
        tags: what must agree, in the order of the C program's `shown`.
        scans: how many one call makes when many do.
    """

    name: str
    il: str
    c: str
    tags: tuple[str, ...]
    scans: int


# ---------------------------------------------------------------- 1,000 Boolean instructions

VARIABLES = 128


def rungs(instructions: int) -> list[Rung]:
    """Return random rungs with so many instructions in all."""
    chance, made = random.Random(42), []
    while instructions:
        length = min(chance.randrange(3, 12), instructions - 1)
        if instructions - length - 1 == 1:
            length += 1
        row = [(chance.choice(("AND", "OR", "XOR")) if n else "LD", chance.random() < 0.3,
                chance.randrange(VARIABLES)) for n in range(length)]
        made.append((row, chance.randrange(VARIABLES)))
        instructions -= length + 1
    return made


def boolean_case() -> Case:
    rows = rungs(1000)
    names = [f"b{n}" for n in range(VARIABLES)]
    il = [f"{op}{'N' * negated} {names[v]}" if at < len(row) else f"ST {names[target]}"
          for row, target in rows for at, (op, negated, v) in enumerate([*row, ("", False, 0)])]
    text = "\n".join([f"PROGRAM MAIN\nVAR {', '.join(names)} : BOOL; END_VAR", *il, "END_PROGRAM"])
    signs = {"AND": "&", "OR": "|", "XOR": "^"}
    statements = []
    for row, target in rows:
        term = ""
        for op, negated, v in row:
            operand = f"(s->b{v} ^ 1)" if negated else f"s->b{v}"
            term = f"({term} {signs[op]} {operand})" if term else operand
        statements.append(f"  s->b{target} = {term};")
    fields = "".join(f"  unsigned char b{n};\n" for n in range(VARIABLES))
    shown = "".join(f"  out[{n}] = s->b{n};\n" for n in range(VARIABLES))
    return Case("bool", text, c_text(fields, "", "\n".join(statements), shown), tuple(names),
                20_000)


# ---------------------------------------------------------------- timers, counters, arithmetic

UNIT_IL = """\
LDN t{n}.Q
ST t{n}.IN
CAL t{n}(PT := T#{pt}ms)
LD t{n}.Q
ST c{n}.CU
CAL c{n}(R := c{n}.Q, PV := {pv})
LD c{n}.CV
ADD i{n}
MUL 3
SUB k{n}
ST i{n}
GT k{n}
ST y{n}
"""

UNIT_C = """\
  s->t{n}.in = !s->t{n}.q; s->t{n}.pt = {pt}000000LL;
  ton(&s->t{n}, dt);
  s->c{n}.cu = s->t{n}.q; s->c{n}.r = s->c{n}.q; s->c{n}.pv = {pv};
  ctu(&s->c{n});
  s->i{n} = (short)((s->c{n}.cv + s->i{n}) * 3 - s->k{n});
  s->y{n} = s->i{n} > s->k{n};
"""

BLOCKS_C = """\
typedef struct { unsigned char in, q, timing; long long pt, et; } TON;
typedef struct { unsigned char cu, r, q, before; short pv, cv; } CTU;
static void ton(TON *t, long long dt) {
  if (!t->in) { t->timing = 0; t->q = 0; t->et = 0; return; }
  if (!t->timing) { t->timing = 1; t->et = 0; }
  else if (!t->q) t->et += dt;
  if (!t->q && t->et >= t->pt) { t->q = 1; t->et = t->pt; }
}
static void ctu(CTU *c) {
  if (c->r) c->cv = 0;
  else if (c->cu && !c->before && c->cv < 32767) c->cv++;
  c->before = c->cu;
  c->q = c->cv >= c->pv;
}
"""


def mixed_case() -> Case:
    chance = random.Random(7)
    numbers = [(n, chance.randrange(2, 30) * 10, chance.randrange(3, 20), chance.randrange(-50, 50))
               for n in range(UNITS)]
    declared = "".join(f"t{n} : TON; c{n} : CTU; i{n} : INT; k{n} : INT := {k}; y{n} : BOOL;\n"
                       for n, _, _, k in numbers)
    body = "".join(UNIT_IL.format(n=n, pt=pt, pv=pv) for n, pt, pv, _ in numbers)
    fields = "".join(f"  TON t{n}; CTU c{n}; short i{n}, k{n}; unsigned char y{n};\n"
                     for n, *_ in numbers)
    code = "".join(UNIT_C.format(n=n, pt=pt, pv=pv) for n, pt, pv, _ in numbers)
    code = "  if (!s->set) { s->set = 1;" + "".join(f" s->k{n} = {k};" for n, _, _, k in numbers) \
        + " }\n" + code
    tags = tuple(f"{part}{n}{tail}" for n in range(UNITS)
                 for part, tail in (("t", ".ET"), ("c", ".CV"), ("i", ""), ("y", "")))
    shown = "".join(f"  out[{at}] = s->{tag.lower()};\n" for at, tag in enumerate(tags))
    return Case("mixed", f"PROGRAM MAIN\nVAR\n{declared}END_VAR\n{body}END_PROGRAM",
                c_text(fields + "  int set;\n", BLOCKS_C, code, shown), tags, 10_000)


def c_text(fields: str, blocks: str, code: str, shown: str) -> str:
    """Return a C program; `scan` is a function of its own, as the engine's is."""
    return f"""\
{blocks}
typedef struct {{
{fields}}} State;
__attribute__((noinline)) void scan(State *s, long long dt) {{
{code}
}}
void many(State *s, long long n, long long dt) {{ while (n--) scan(s, dt); }}
void shown(State *s, long long *out) {{
{shown}}}
long long size(void) {{ return sizeof(State); }}
"""


class Native:
    """The C program, built and loaded."""

    def __init__(self, case: Case, folder: Path) -> None:
        source, library = folder / f"{case.name}.c", folder / f"{case.name}.so"
        source.write_text(case.c)
        subprocess.run(["gcc", "-O2", "-shared", "-fPIC", "-o", str(library), str(source)],
                       check=True)
        self._code = ctypes.CDLL(str(library))
        self._code.size.restype = ctypes.c_longlong
        self._state = ctypes.create_string_buffer(self._code.size())
        self._count = len(case.tags)

    def many(self, scans: int) -> None:
        self._code.many(self._state, ctypes.c_longlong(scans), ctypes.c_longlong(STEP_NS))

    def values(self) -> list[int]:
        out = (ctypes.c_longlong * self._count)()
        self._code.shown(self._state, out)
        return list(out)


class Emulated:
    """The IL program on one engine."""

    def __init__(self, case: Case, program: Program, engine: str) -> None:
        self.engine: Engine = make_engine(engine, program)
        self.code = self.engine.prepare([(i.function, i.base) for i in program.instances])
        slots = {s.tag.name.casefold(): s for s in program.layout.slots}
        self._places = [slots[f"main.{t}".casefold()] for t in case.tags]

    def many(self, scans: int) -> None:
        self.code.repeat(scans, STEP_NS)

    def values(self) -> list[int]:
        sizes = {"BOOL": 1, "INT": 2, "TIME": 8}
        return [int.from_bytes(self.engine.block[s.offset:s.offset + sizes[s.tag.type]], "little",
                               signed=True) for s in self._places]


def seconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def measure(case: Case, rounds: int, native: Native | None) -> dict[str, float]:
    """Return the figures of one program, us for each scan unless the name says otherwise."""
    program = compile_program(case.il)
    wasm, slow = Emulated(case, program, "wasm"), Emulated(case, program, "interpreter")
    for way in filter(None, (wasm, slow, native)):
        way.many(173)
    for way in filter(None, (slow, native)):
        if way.values() != wasm.values():
            raise SystemExit(f"{case.name}: {type(way).__name__} computes something else")

    def ready() -> None:
        Emulated(case, compile_program(case.il), "wasm").code.run()

    singles = 1000
    ways: dict[str, tuple[Callable[[], object], float]] = {
        "wasm": (lambda: wasm.many(case.scans), case.scans / 1e6),
        "single": (lambda: [wasm.code.run() for _ in range(singles)], singles / 1e6),
        "interpreter": (lambda: slow.many(3), 3 / 1e6),
        "ready_ms": (ready, 1e-3),
    }
    if native:
        ways["c"] = (lambda: native.many(case.scans), case.scans / 1e6)
    times = {name: min(seconds(work) for _ in range(1)) for name, (work, _) in ways.items()}
    for _ in range(rounds):
        for name, (work, _) in ways.items():
            times[name] = min(times[name], seconds(work))
    return {name: times[name] / unit for name, (_, unit) in ways.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for case in (boolean_case(), mixed_case()):
            native = Native(case, Path(folder)) if shutil.which("gcc") else None
            found[case.name] = figures = measure(case, arguments.rounds, native)
            if native:
                figures["times_c"] = figures["wasm"] / figures["c"]
    if arguments.json:
        print(json.dumps(found, indent=2))
        return
    if not shutil.which("gcc"):
        print("gcc is not installed: nothing to compare with")
    for name, figures in found.items():
        ratio, single, ready = PROMISED[name]
        print(f"\n{name}")
        if "c" in figures:
            print(f"  many scans in one call {figures['wasm']:9.3f} us a scan, in C "
                  f"{figures['c']:.3f}: {figures['times_c']:.2f} times (promised {ratio:g})")
        else:
            print(f"  many scans in one call {figures['wasm']:9.3f} us a scan")
        print(f"  one scan a call        {figures['single']:9.3f} us (promised {single:g})")
        print(f"  the interpreter        {figures['interpreter']:9.1f} us")
        print(f"  source to running      {figures['ready_ms']:9.1f} ms (promised {ready:g})")


if __name__ == "__main__":
    main()
