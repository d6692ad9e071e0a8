"""The program's translation to Promela, executed by SPIN, beside the interpreter's scans."""

from __future__ import annotations

import random
import struct
from itertools import product
from pathlib import Path

from engines_compared import numbered, program_of, random_value
from ir_random import edges
from promela_lockstep import Case, differences
from promela_programs import TEXTS, random_text
from tools import need_spin

from plcemu.base.errors import CompileError
from plcemu.ir.ops import STRUCT_CODES, VALUE_OPS
from plcemu.ir.program import Function, Instr
from plcemu.lang.compile import compile_program
from plcemu.verify.promela.operations import WIDE

SAID = [op for op, row in VALUE_OPS.items()
        if not {*row.pops, row.pushes} & set(WIDE)]
"""Operations that Promela can say: those on values of 32 bits or less that are no REAL."""

RET = Instr("ret")


def operation(op: str) -> Case:
    """An operation on every combination of its operands' edges, and on any bits."""
    row, chance = VALUE_OPS[op], random.Random(11)
    code = [*(Instr("load", (m, "memory", 8 * n)) for n, m in enumerate(row.pops)),
            Instr(op), Instr("store", (row.pushes, "memory", 16)), RET]
    program = program_of([Function("F", numbered(code), (), "", "P")], bytes(32))
    operands = list(product(*(edges(m) for m in row.pops)))
    writes = [{8 * n: struct.pack("<" + STRUCT_CODES[m], v)
               for n, (m, v) in enumerate(zip(row.pops, values, strict=True))}
              for values in operands]
    writes += [{8 * n: chance.randbytes(8) for n, m in enumerate(row.pops) if m != "bool"}
               for _ in range(20)]
    return Case(op, program, [("F", 0)], writes)


def test_every_operation_leaves_the_same_bits_as_in_the_interpreter(tmp_path: Path) -> None:
    need_spin()
    cases = [operation(op) for op in SAID]
    assert len(cases) > 150
    assert differences(cases, tmp_path) == ""
    faulting = {case.name.split(".")[0] for case in cases if case.faults}
    assert faulting == {"div", "mod", "shl", "shr", "rol", "ror"}


def scans(name: str, text: str) -> Case | None:
    """A program scanned with random values in its variables now and then."""
    try:
        program = compile_program(text)
    except CompileError:
        return None
    chance, writes = random.Random(text), []
    slots = [s for s in program.layout.slots if not s.tag.type.startswith("TIME")]
    for _ in range(40):
        chosen = chance.sample(slots, min(len(slots), chance.choice((0, 1, 4))))
        writes.append({s.offset: random_value(s.tag.type, chance) for s in chosen})
    return Case(name, program, [(i.function, i.base) for i in program.instances], writes)


def test_programs_leave_the_same_memory_after_every_scan(tmp_path: Path) -> None:
    need_spin()
    made = [scans(name, text) for name, text in TEXTS.items()]
    made += [scans(f"random {seed}", random_text(seed)) for seed in range(40)]
    cases = [case for case in made if case is not None]
    assert len(cases) > 30
    assert None not in made[:len(TEXTS)]
    assert differences(cases, tmp_path) == ""
    assert 5 < sum(case.faults for case in cases) < 500
