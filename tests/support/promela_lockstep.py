"""Scans in SPIN beside scans of the interpreter: after each one memory must be the same.

Every case becomes a process that scans a program on inputs from a table and compares each variable
with what the interpreter left there. All cases go through SPIN and the compiler together.
"""

from __future__ import annotations

import struct
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from plcemu.base.errors import ProgramFault
from plcemu.engine.interpreter import Interpreter
from plcemu.ir.ops import STRUCT_CODES
from plcemu.ir.program import Program
from plcemu.verify.promela.code import Cell, Cells, ScanWriter
from plcemu.verify.promela.operations import number

BUDGET = 2_000


@dataclass
class Case:
    """A program, the functions of one scan, and what is written into memory before each scan.

    After a fault memory begins anew, as the interpreter had it before the first scan.
    """

    name: str
    program: Program
    runs: Sequence[tuple[str, int]]
    writes: Sequence[Mapping[int, bytes]]
    faults: int = field(default=0, init=False)


def _value(block: bytes, cell: Cell) -> int:
    value, = struct.unpack_from("<" + STRUCT_CODES[cell.machine], block, cell.offset)
    return value - (1 << 32) if cell.machine == "u32" and value >> 31 else int(value)


def _series(case: Case, cells: Sequence[Cell]) -> tuple[list[list[int]], list[list[int]]]:
    """Return for each scan the cells' values before it, and after it with whether it faulted."""
    initial = bytes(case.program.layout.initial)
    block = bytearray(initial)
    engine = Interpreter(case.program, block, BUDGET)
    before, after = [], []
    for written in case.writes:
        for offset, data in written.items():
            block[offset:offset + len(data)] = data
        before.append([_value(block, cell) for cell in cells])
        try:
            engine.run_all(list(case.runs), BUDGET)
            after.append([0, *(_value(block, cell) for cell in cells)])
        except ProgramFault:
            after.append([1, *[0] * len(cells)])
            case.faults += 1
            block[:] = initial
    return before, after


def _process(number_: int, case: Case) -> tuple[list[str], list[str]]:
    """Return a case as the lines of a process and of its tables in C."""
    cells = Cells(case.program, None)
    writer = ScanWriter(case.program, cells, BUDGET)
    writer.write(case.runs)
    known = list(cells)
    before, after = _series(case, known)
    tables = [f"static const int before_{number_}[][{len(known) + 1}] = {{",
              *("{" + ",".join(map(str, [*row, 0])) + "}," for row in before), "};",
              f"static const int after_{number_}[][{len(known) + 1}] = {{",
              *("{" + ",".join(map(str, row)) + "}," for row in after), "};"]

    def expected(column: int) -> str:
        return f"c_expr {{ after_{number_}[now.row][{column}] }}"

    lines = [f"proctype case_{number_}() {{  /* {case.name} */", "int fault;", "int budget_left;",
             *(f"int spare_{n};" for n in range(writer.spares)),
             *(f"int local_{n};" for n in range(writer.locals)),
             *(cell.declaration for cell in known),
             "do", f":: row < {len(before)} -> d_step {{", "fault = 0;", f"budget_left = {BUDGET};",
             *(f"{c.name} = c_expr {{ before_{number_}[now.row][{n}] }};"
               for n, c in enumerate(known)), *writer.lines, "scanned: skip;",
             "if :: fault -> fault = 1 :: else fi;", _compare(number_, "fault", expected(0)),
             "if :: fault -> skip :: else ->", "skip;",
             *(_compare(number_, c.name, expected(n + 1)) for n, c in enumerate(known)),
             "fi;", "row++", "}", ":: else -> break", "od;", "row = 0", "}"]
    return lines, tables


def _compare(case: int, name: str, expected: str) -> str:
    return (f'if :: {name} == {expected} -> skip :: else -> printf("case {case} row %d {name} %d '
            f'not %d\\n", row, {name}, {expected}); assert(false) fi;')


def differences(cases: Sequence[Case], folder: Path) -> str:
    """Run all cases in SPIN; return where one differs from the interpreter, empty if none does."""
    lines, tables = ["c_decl {", '  \\#include "tables.h"', "}", "int row;"], []
    for n, case in enumerate(cases):
        body, table = _process(n, case)
        lines += body
        tables += table
    lines += ["init {", *(f"run case_{n}(); _nr_pr == 1;"
                          for n in range(len(cases))), 'printf("all cases are through\\n")', "}"]
    (folder / "model.pml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (folder / "tables.h").write_text("\n".join(tables) + "\n", encoding="utf-8")
    _run(folder, "spin", "-a", "model.pml")
    _run(folder, "gcc", "-O0", "-w", "-fwrapv", "-DSAFETY", "-DNOREDUCE", "-DVECTORSZ=8192",
         "-o", "pan", "pan.c")
    output = _run(folder, "./pan", "-m1000000", "-w18")
    if "errors: 0" in output:
        assert "unreached in init\n\t(0 of" in output, output  # so the last case has ended
        return ""
    trail = _run(folder, "./pan", "-r", "-m1000000", may_fail=True)
    told = [line.strip() for line in trail.splitlines() if line.strip().startswith("case ")]
    return told[0] if told else output


def _run(folder: Path, *command: str, may_fail: bool = False) -> str:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=60,
                          check=False, errors="replace")
    assert may_fail or not done.returncode, done.stdout + done.stderr
    return done.stdout + done.stderr


__all__ = ["Case", "differences", "number"]
