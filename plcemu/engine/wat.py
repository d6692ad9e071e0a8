"""A program as WebAssembly text: what `plcemu check --dump wat` prints.

The program's memory block is the end of WebAssembly's memory, so that an address beyond it traps
without a test. Before it stand, in this order, the number of whole runs made, the places of the
clock cells, the lists of functions to run, and the room for batches (`plcemu.engine.batch`), which
takes no memory until it is used.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from plcemu.engine.wat_batch import COMPLETED, each
from plcemu.engine.wat_code import FunctionWriter
from plcemu.engine.wat_ops import KINDS, Helpers
from plcemu.ir.program import Program

PAGE = 65536
"""Bytes of WebAssembly's unit of memory."""

CLOCKS = 64
"""Address of the clock cells' addresses (u32), those that the program reads first."""

RUN_ROOM = 8 * 4096
"""Bytes for the lists of functions to run: each a number in the table and an address (u32)."""

BATCH_ROOM = 16 * PAGE
"""Bytes for a batch: as many copies of the memory block as find room there are run at once."""


@dataclass(frozen=True, slots=True)
class Translated:
    """A program's WebAssembly text and what one must know to use it.

    Attributes:
        text: the module.
        origin: address of the memory block.
        runs: address of the room for lists of functions to run.
        room: address of the room for batches.
        numbers: each function's number in the table.
        fixed: functions that run on one instance only, with its address.
        hosts: imported functions by name: machine types taken, the site last, and given.
        sites: the instruction of each site, as function and number in its code.
    """

    text: str
    origin: int
    runs: int
    room: int
    numbers: dict[str, int]
    fixed: dict[str, int]
    hosts: dict[str, tuple[tuple[str, ...], str]]
    sites: list[tuple[str, int]]


def translate_program(program: Program) -> Translated:
    """Return a program as WebAssembly text."""
    layout, functions = program.layout, program.functions
    runs = CLOCKS + -(-4 * len(layout.clocks) // 8) * 8
    room = runs + RUN_ROOM
    pages = -(-(room + BATCH_ROOM + layout.size) // PAGE)
    origin = pages * PAGE - layout.size
    names, helpers = _names(list(functions)), Helpers(origin, layout.size)
    fixed = _fixed(program)
    bodies = [FunctionWriter(f, functions, names, helpers, fixed.get(f.name)).write()
              for f in functions.values()]
    clocks = sorted(layout.clocks, key=lambda c: not c.observed)
    observed = sum(c.observed for c in clocks)
    cells = b"".join((origin + c.offset).to_bytes(4, "little") for c in clocks)
    parts = [
        "(module", *_imports(helpers),
        f'(memory (export "memory") {pages} {pages})',
        f'(data (i32.const {CLOCKS}) "{_escaped(cells)}")',
        "(global $left (mut i64) (i64.const 0))",
        "(global $budget (mut i64) (i64.const 0))",
        "(type $pou (func (param i32)))",
        *_table(program, names),
        *helpers.used.values(),
        _advance([origin + c.offset for c in clocks]),
        _CLOCKS_RUN.replace("BEGIN", str(CLOCKS)).replace("END", str(CLOCKS + 4 * observed))
        .replace("ANSWER", str(COMPLETED)),
        _RUN_ALL, _REPEAT.replace("COMPLETED", str(COMPLETED)),
        each(origin, layout.size),
        *bodies, ")", ""]
    numbers = {name: n for n, name in enumerate(functions)}
    return Translated("\n".join(parts), origin, runs, room, numbers, fixed, helpers.hosts,
                      helpers.sites)


def _fixed(program: Program) -> dict[str, int]:
    """Return the functions that run on one instance only, with its address.

    Most programs have one: its variables then stand at addresses that are known, which saves an
    addition in every access, and tells them from all others.
    """
    called = {i.arg for f in program.functions.values() for i in f.code if i.op == "call"}
    bases: dict[str, set[int]] = {}
    for instance in program.instances:
        bases.setdefault(instance.function, set()).add(instance.base)
    return {name: min(at) for name, at in bases.items() if len(at) == 1 and name not in called}


def _names(functions: list[str]) -> dict[str, str]:
    """Return a WebAssembly name for each function: its own, as far as its letters allow."""
    names: dict[str, str] = {}
    for name in functions:
        plain = "$pou." + re.sub(r"[^\w.]", "_", name, flags=re.ASCII)
        while plain in names.values():
            plain += "_"
        names[name] = plain
    return names


def _imports(helpers: Helpers) -> list[str]:
    lines = []
    for name, (pops, pushes) in helpers.hosts.items():
        taken = " ".join(KINDS[m] for m in pops)
        given = f" (result {KINDS[pushes]})" if pushes else ""
        lines.append(f'(import "host" "{name}" (func $host.{name} (param {taken}){given}))')
    return lines


def _table(program: Program, names: dict[str, str]) -> list[str]:
    """Return the table of functions to run; a result that nobody takes is dropped."""
    lines, entries = [], []
    for function in program.functions.values():
        name = names[function.name]
        if function.result:
            lines.append(f"(func {name}.run (param i32) local.get 0 call {name} drop)")
            name += ".run"
        entries.append(name)
    count = len(entries)
    return [f"(table {count} {count} funcref)",
            f"(elem (i32.const 0) func {' '.join(entries)})", *lines]


def _escaped(data: bytes) -> str:
    return "".join(f"\\{byte:02x}" for byte in data)


UNROLLED = 256
"""Clock cells that are advanced one by one, without a loop."""


def _advance(cells: list[int]) -> str:
    """Return the function that lets time pass for clock cells at these addresses."""
    if len(cells) <= UNROLLED:
        body = "\n".join(_advance_one(f"i32.const {cell}") for cell in cells)
    else:
        body = f"""\
  (local.set $at (i32.const {CLOCKS}))
  loop $next
    (local.set $cell (i32.load (local.get $at)))
{_advance_one("local.get $cell")}
    (local.set $at (i32.add (local.get $at) (i32.const 4)))
    (br_if $next (i32.lt_u (local.get $at) (i32.const {CLOCKS + 4 * len(cells)})))
  end"""
    return f"""\
(func $advance (export "advance") (param $elapsed i64)
  (local $at i32) (local $cell i32) (local $count i64) (local $limit i64)
{body})"""


def _advance_one(cell: str) -> str:
    """Return code without branches: which timers run changes too often to be foreseen."""
    return f"""\
  (local.set $count (i64.load ({cell})))
  (local.set $limit (i64.load offset=8 ({cell})))
  (i64.store ({cell})
    (select
      (select (i64.add (local.get $count) (local.get $elapsed)) (local.get $limit)
        (i64.lt_u (local.get $elapsed) (i64.sub (local.get $limit) (local.get $count))))
      (local.get $count)
      (i64.lt_s (local.get $count) (local.get $limit))))"""


_CLOCKS_RUN = """\
(func (export "clocks_run")
  (local $at i32) (local $cell i32)
  (i64.store (i32.const ANSWER) (i64.const 0))
  (local.set $at (i32.const BEGIN))
  block $end
    loop $next
      (br_if $end (i32.ge_u (local.get $at) (i32.const END)))
      (local.set $cell (i32.load (local.get $at)))
      (if (i64.lt_s (i64.load (local.get $cell)) (i64.load offset=8 (local.get $cell))) (then
        (i64.store (i32.const ANSWER) (i64.const 1))
        return))
      (local.set $at (i32.add (local.get $at) (i32.const 4)))
      br $next
    end
  end)"""

_RUN_ALL = """\
(func $run_all (param $runs i64) (param $end i64) (param $limit i64)
  (local $at i32)
  (global.set $left (local.get $limit))
  (local.set $at (i32.wrap_i64 (local.get $runs)))
  block $ran
    loop $next
      (br_if $ran (i32.ge_u (local.get $at) (i32.wrap_i64 (local.get $end))))
      (call_indirect (type $pou)
        (i32.load offset=4 (local.get $at)) (i32.load (local.get $at)))
      (local.set $at (i32.add (local.get $at) (i32.const 8)))
      br $next
    end
  end)"""

_REPEAT = """\
(func (export "repeat")
  (param $runs i64) (param $end i64) (param $count i64) (param $elapsed i64) (param $limit i64)
  (i64.store (i32.const COMPLETED) (i64.const 0))
  (global.set $budget (local.get $limit))
  block $done
    loop $again
      (br_if $done (i64.eqz (local.get $count)))
      (if (i64.ne (local.get $elapsed) (i64.const 0)) (then (call $advance (local.get $elapsed))))
      (call $run_all (local.get $runs) (local.get $end) (local.get $limit))
      (i64.store (i32.const COMPLETED) (i64.add (i64.load (i32.const COMPLETED)) (i64.const 1)))
      (local.set $count (i64.sub (local.get $count) (i64.const 1)))
      br $again
    end
  end)"""

