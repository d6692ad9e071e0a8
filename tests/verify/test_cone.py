"""The cone of influence: what is cut away never shows in what is kept."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plcemu.engine.resource import Resource
from plcemu.ir.program import Program
from plcemu.lang.compile import compile_program
from plcemu.verify.cone import cone_of
from plcemu.verify.machine import ScanMachine

COUNTERS = """PROGRAM MAIN
VAR button AT %IX0.0 : BOOL; lamp AT %QX0.0 : BOOL; bell AT %QX0.1 : BOOL; END_VAR
VAR presses, scans, sum, limit : INT; last : BOOL;
  table : ARRAY[0..3] OF INT := [5, 7, 9, 11]; place : INT; END_VAR
scans := scans + 1;
IF button AND NOT last THEN presses := presses + 1; END_IF;
last := button;
sum := sum + table[presses MOD 4];
limit := table[place];
lamp := presses > limit;
bell := presses > 3 AND button;
END_PROGRAM
"""


def offset(program: Program, name: str) -> int:
    return next(s.offset for s in program.layout.slots if s.tag.name == f"MAIN.{name}")


@pytest.fixture(scope="module")
def program() -> Program:
    return compile_program(COUNTERS)


def kept(program: Program, *asked: str) -> set[str]:
    cone = cone_of(program, [offset(program, name) for name in asked])
    assert cone is not None
    return {s.tag.name.removeprefix("MAIN.") for s in program.layout.slots if s.offset in cone}


def test_a_counter_that_nothing_looks_at_is_cut_away(program: Program) -> None:
    assert {"scans", "sum"}.isdisjoint(kept(program, "lamp"))


def test_what_a_kept_value_is_computed_from_is_kept(program: Program) -> None:
    assert {"lamp", "presses", "limit", "button", "last"} <= kept(program, "lamp")


def test_an_element_of_an_array_may_be_any_of_them(program: Program) -> None:
    assert {"place", *(f"table[{n}]" for n in range(4))} <= kept(program, "lamp")


def test_what_is_asked_about_is_kept(program: Program) -> None:
    assert "sum" in kept(program, "sum") and "sum" not in kept(program, "bell")


def test_an_address_known_only_at_run_time_keeps_everything() -> None:
    program = compile_program("""FUNCTION_BLOCK FB VAR_IN_OUT x : INT; END_VAR x := x + 1;
END_FUNCTION_BLOCK
PROGRAM MAIN VAR f : FB; a : INT; END_VAR f(x := a); END_PROGRAM
""")
    assert cone_of(program, [0]) is None


@settings(max_examples=25, deadline=None)
@given(st.binary(min_size=2, max_size=2), st.binary(min_size=2, max_size=2),
       st.lists(st.booleans(), min_size=1, max_size=12))
def test_what_is_cut_away_never_shows_in_what_is_kept(
        scans: bytes, total: bytes, presses: list[bool]) -> None:
    program = compile_program(COUNTERS)
    cone = cone_of(program, [offset(program, "lamp"), offset(program, "bell")])
    machine = ScanMachine(Resource(program, 10_000_000, "interpreter"), kept=cone)
    plain, other = bytearray(machine.initial), bytearray(machine.initial)
    other[offset(program, "scans"):offset(program, "scans") + 2] = scans
    other[offset(program, "sum"):offset(program, "sum") + 2] = total
    button = offset(program, "button")
    for pressed in presses:
        plain[button] = other[button] = pressed
        plain, other = (bytearray(machine.scan(bytes(m), ())) for m in (plain, other))
        assert machine.reduced(plain) == machine.reduced(other)
