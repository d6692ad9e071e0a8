"""Every operation of the machine alone, at the edges of its types, on both engines."""

import itertools
import random
import struct

import pytest
from engines_compared import Pair, numbered, program_of
from ir_random import CAPACITY, STRINGS, TEXTS, Maker, edges, image

from plcemu.ir.builtins import BUILTINS, write_string
from plcemu.ir.ops import MACHINE_TYPES, STRUCT_CODES, VALUE_OPS
from plcemu.ir.program import Function, Instr

RESULT = 64
RET = Instr("ret")


def pushing(machine, place, value):
    """Push an operand from memory, or as a constant where a value is given."""
    return Instr("load", (machine, "memory", place)) if value is None else \
        Instr("const", (machine, value))


def function_of(name, op, constants):
    row = VALUE_OPS[op]
    pushes = [pushing(m, 8 * n, value)
              for n, (m, value) in enumerate(zip(row.pops, constants, strict=True))]
    code = [*pushes, Instr(op), Instr("store", (row.pushes, "memory", RESULT)), RET]
    return Function(name, numbered(code), (), "", "P")


def operands(op, seed):
    """Every combination of edges, and some of any bits."""
    row, chance = VALUE_OPS[op], random.Random(seed)
    for values in itertools.product(*(edges(m) for m in row.pops)):
        yield b"".join(struct.pack("<" + STRUCT_CODES[m], v).ljust(8, b"\0")
                       for m, v in zip(row.pops, values, strict=True))
    for _ in range(20):
        yield chance.randbytes(8 * len(row.pops))


STEMS = sorted({op.split(".")[0] for op in VALUE_OPS})


@pytest.mark.parametrize("stem", STEMS)
def test_an_operation_on_operands_from_memory(stem):
    ops = [op for op in VALUE_OPS if op.split(".")[0] == stem]
    pair = Pair(program_of([function_of(op, op, [None] * len(VALUE_OPS[op].pops)) for op in ops],
                           bytes(80)))
    for op in ops:
        for n, data in enumerate(operands(op, 7)):
            pair.write(0, data)
            pair.write(RESULT, bytes([n % 256]) * 8)
            pair.run(op)


BINARY = [op for op in VALUE_OPS if len(VALUE_OPS[op].pops) == 2]


@pytest.mark.parametrize("stem", sorted({op.split(".")[0] for op in BINARY}))
def test_an_operation_whose_right_operand_is_a_constant(stem):
    chance = random.Random(3)
    rows = [(op, right) for op in BINARY if op.split(".")[0] == stem
            for right in chance.sample(edges(VALUE_OPS[op].pops[1]), k=2)
            + [v for v in edges(VALUE_OPS[op].pops[1]) if v in (0, -1, 7)]]
    pair = Pair(program_of([function_of(f"F{n}", op, [None, right])
                            for n, (op, right) in enumerate(rows)], bytes(80)))
    for n, (op, _) in enumerate(rows):
        for left in edges(VALUE_OPS[op].pops[0]):
            pair.write(0, struct.pack("<" + STRUCT_CODES[VALUE_OPS[op].pops[0]], left))
            pair.run(f"F{n}")


@pytest.mark.parametrize("name", BUILTINS)
def test_a_built_in_function(name):
    maker, code = Maker(1), []
    row = BUILTINS[name]
    functions = []
    for n in range(12):
        maker.code = code = []
        maker.locals = ["i64"]
        maker.builtin(name, 1)
        if row.pushes:
            code.append(Instr("store", (row.pushes, "memory", RESULT)))
        functions.append(Function(f"F{n}", numbered([*code, RET]), ("i64",), "", "P"))
    chance = random.Random(2)
    pair = Pair(program_of(functions, image(chance)))
    for function in functions * 2:
        for n, address in enumerate(STRINGS):
            block = bytearray(2 + CAPACITY * (1 + n % 2))
            write_string(block, 0, CAPACITY, chance.choice(TEXTS), "sw"[n % 2])
            pair.write(address, bytes(block))
        pair.run(function.name)


@pytest.mark.parametrize("machine", MACHINE_TYPES)
@pytest.mark.parametrize("base", [0, 16])
def test_loads_stores_and_locals_keep_a_value_but_for_the_bits_of_a_nan(machine, base):
    code = [Instr("load", (machine, "this", 0)), Instr("set", 0), Instr("get", 0),
            Instr("store", (machine, "memory", RESULT)),
            Instr("addr", ("this", 0)), Instr("loadat", (machine, 0)), Instr("set", 0),
            Instr("addr", ("this", 24)), Instr("get", 0), Instr("storeat", (machine, 8)), RET]
    pair = Pair(program_of([Function("F", numbered(code), (machine,))], bytes(80)))
    chance = random.Random(5)
    nans = [struct.pack("<Q", bits) for bits in
            (0x7FF0000000000001, 0xFFF8000000000000, 0x7FF8000012345678, 0x7F8000017F800001)]
    for data in [*nans, *(chance.randbytes(8) for _ in range(200))]:
        pair.write(base, data)
        pair.run("F", base)
