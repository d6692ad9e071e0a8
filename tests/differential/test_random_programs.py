"""Random programs on both engines: every operation, any flow of control, faults, budgets."""

import random

import pytest
from engines_compared import Pair
from ir_random import BASES, CELLS, DATA, Maker

from plcemu.base.errors import ProgramFault
from plcemu.ir.builtins import BUILTINS
from plcemu.ir.ops import STRUCTURAL, VALUE_OPS
from plcemu.lang.compile import compile_program

FORWARD = range(60)
ANY = range(1000, 1100)


def agree(program, seed, budget, bases=BASES):
    """Run every function on changing memory and instances; both engines do the same."""
    pair, chance = Pair(program, budget), random.Random(seed)
    outcomes = []
    for _ in range(4):
        for name in program.functions:
            pair.write(0, chance.randbytes(DATA))
            pair.write(CELLS[0], bytes([chance.randrange(200)]).ljust(8, b"\0"))
            pair.write(CELLS[1] + 8, bytes([chance.randrange(200)]).ljust(8, b"\0"))
            outcomes.append(pair.run(name, chance.choice(bases)))
            pair.advance(chance.randrange(100))
    return outcomes


@pytest.mark.parametrize("seed", FORWARD)
def test_straight_code_and_jumps_forwards(seed):
    agree(Maker(seed, "forward").program(), seed, 1_000_000)


@pytest.mark.parametrize("seed", range(2000, 2030))
def test_functions_with_one_instance_only(seed):
    base = BASES[seed % 3]
    agree(Maker(seed, bases=(base,)).program(), seed, 1000, (base,))


@pytest.mark.parametrize("seed", ANY)
def test_jumps_in_any_direction_within_a_budget(seed):
    agree(Maker(seed).program(), seed, 300)


COUNTS = """PROGRAM MAIN VAR i, n : INT; END_VAR
FOR i := 1 TO 5 DO n := n + 1; END_FOR; REPEAT n := n + 2; UNTIL n > 14 END_REPEAT; END_PROGRAM"""


def test_a_budget_of_any_size_ends_at_the_same_instruction():
    pair = Pair(compile_program(COUNTS))
    slow, fast = (e.prepare([("MAIN", 0)] * 2) for e in (pair.oracle, pair.fast))
    ends = set()
    for budget in range(300):
        pair.write(0, bytes(pair.program.layout.size))
        slow.budget = fast.budget = budget
        found = [ending(code) for code in (slow, fast)]
        assert found[0] == found[1]
        pair.same()
        ends.add(found[0])
    assert len(ends) > 100


def ending(code):
    try:
        code.run()
    except ProgramFault as fault:
        return fault.reason, fault.place, code.completed
    return "", "", code.completed


def test_the_random_programs_meet_every_kind_of_end():
    reasons = {reason for seed in ANY[:40] for end in agree(Maker(seed).program(), seed, 300)
               for reason in end[:1]}
    for part in ("division by zero", "index", "the scan does not end", "no integer value",
                 "reason", "negative number of bits"):
        assert any(part in reason for reason in reasons), part


def test_the_random_programs_hold_every_operation():
    made = [instr for flow, seeds in (("forward", FORWARD), ("any", ANY)) for seed in seeds
            for function in Maker(seed, flow).program().functions.values()
            for instr in function.code]
    assert {i.op for i in made} >= {*VALUE_OPS, *STRUCTURAL}
    assert {i.arg for i in made if i.op == "builtin"} == set(BUILTINS)
