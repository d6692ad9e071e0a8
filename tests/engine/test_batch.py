"""Batches: many copies of memory, run in one call as they are run one after the other."""

from __future__ import annotations

import pytest

from plcemu.engine.batch import PlainBatch, Shape
from plcemu.engine.interpreter import Interpreter
from plcemu.engine.wasm import WasmEngine
from plcemu.engine.wasm_batch import WasmBatch
from plcemu.ir.program import Program
from plcemu.lang.compile import compile_program

COUNTING = """PROGRAM MAIN
VAR per AT %IW0 : INT; out AT %QW0 : INT; late : TON; n : DINT; END_VAR
late(IN := TRUE, PT := T#1s);
n := n + 1;
IF late.Q THEN out := 100 / per; ELSE out := per; END_IF;
END_PROGRAM
"""
BIG = """PROGRAM MAIN
VAR per AT %IW0 : INT; out AT %QW0 : INT; big : ARRAY[1..300000] OF DINT; END_VAR
out := out + per;
big[per] := 1;
END_PROGRAM
"""


def place(program: Program, name: str) -> slice:
    slot = next(s for s in program.layout.slots if s.tag.name == f"MAIN.{name}")
    return slice(slot.offset, slot.offset + 2)


def shape_of(program: Program) -> Shape:
    """Everything matters but n; told is the output."""
    size = program.layout.size
    mask, rest = bytearray(b"\xff" * size), bytearray(size)
    cut = next((s.offset for s in program.layout.slots if s.tag.name == "MAIN.n"), size)
    mask[cut:cut + 4], rest[cut:cut + 4] = bytes(4)[:size - cut], b"\x07\0\0\0"[:size - cut]
    out = place(program, "out")
    return Shape([place(program, "per")], bytes(mask), bytes(rest), range(out.start, out.stop))


def both(text: str) -> tuple[WasmBatch | PlainBatch, PlainBatch, Program]:
    program = compile_program(text)
    runs = [(i.function, i.base) for i in program.instances]
    engines = WasmEngine(program), Interpreter(program, bytearray(program.layout.initial))
    fast, plain = (engine.batch(runs, shape_of(program)) for engine in engines)
    assert isinstance(plain, PlainBatch) and isinstance(fast, WasmBatch | PlainBatch)
    return fast, plain, program


def number(value: int) -> bytes:
    return value.to_bytes(2, "little")


def test_both_ways_tell_the_same_round_after_round() -> None:
    fast, plain, program = both(COUNTING)
    for batch in (fast, plain):
        batch.load([program.layout.initial] * 5)
    for places, values in (([0, 1, 2, 3, 4], [5, 1, 2, 3, 4]), ([4, 0, 2], [4, 5, 7])):
        ran = [b.run(places, [b.image([number(v)]) for v in values], 300_000_000)
               for b in (fast, plain)]
        assert ran[0].told == ran[1].told == [number(v) for v in values]
        assert list(ran[0].changed) == list(ran[1].changed)
        assert fast.memories() == plain.memories()


def test_what_is_cut_away_gets_its_value_and_is_no_change() -> None:
    fast, _, program = both(COUNTING.replace("out := per", "out := out").replace("TRUE", "FALSE"))
    fast.load([program.layout.initial])
    image = fast.image([number(0)])
    fast.run([0], [image], 0)
    assert not fast.run([0], [image], 0).changed[0]


def test_a_fault_is_that_of_its_run_and_leaves_its_copy_as_it_was() -> None:
    fast, plain, program = both(COUNTING)
    for batch in (fast, plain):
        batch.load([program.layout.initial] * 4)
        batch.run(range(4), [batch.image([number(1)])] * 4, 0)
        before = batch.memories()
        images = [batch.image([number(v)]) for v in (0, 2, 0, 4)]
        ran = batch.run(range(4), images, 2_000_000_000)
        assert {n: fault.reason for n, fault in ran.faults.items()} \
            == {0: "division by zero", 2: "division by zero"}
        assert [ran.told[1], ran.told[3]] == [number(50), number(25)]
        assert [batch.memories()[n] == before[n] for n in range(4)] == [True, False, True, False]
    assert fast.memories() == plain.memories()


def test_a_memory_too_large_for_a_batch_is_run_one_after_another() -> None:
    fast, _, program = both(BIG)
    assert isinstance(fast, PlainBatch)
    fast.load([program.layout.initial] * 2)
    ran = fast.run([0, 1], [fast.image([number(v)]) for v in (3, 4)], 0)
    assert ran.told == [number(3), number(4)]


def test_two_batches_of_an_engine_do_not_disturb_each_other_once_loaded() -> None:
    program = compile_program(COUNTING)
    engine, shape = WasmEngine(program), shape_of(program)
    runs = [(i.function, i.base) for i in program.instances]
    first, second = engine.batch(runs, shape), engine.batch(runs, shape._replace(told=[0]))
    second.load([program.layout.initial])
    first.load([program.layout.initial])
    assert first.run([0], [first.image([number(9)])], 0).told == [number(9)]


@pytest.mark.parametrize("elements", [4, 20_000, 60_000])
def test_a_batch_holds_as_many_copies_as_it_says(elements: int) -> None:
    fast, _, program = both(BIG.replace("300000", str(elements)))
    assert isinstance(fast, WasmBatch)
    many = [program.layout.initial] * fast.capacity
    fast.load(many)
    fast.run(range(len(many)), [fast.image([number(1)])] * len(many), 0)
    assert len(fast.memories()) == len(many) and len(set(fast.memories())) == 1
