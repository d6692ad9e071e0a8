"""Standard functions by the name of one type, such as ADD_INT (2nd edition, 2.5.1.4)."""

from __future__ import annotations

import pytest

import plcemu
from plcemu.base.errors import CompileError


def test_a_typed_name_is_the_overloaded_function() -> None:
    plc = plcemu.Plc("""PROGRAM m
        VAR i : INT := 3; n, k : INT; r : REAL; b : BOOL; w : WORD; END_VAR
        n := ADD_INT(i, 4); r := SQRT_REAL(2.25); b := GT_INT(n, i); w := SHL_WORD(WORD#1, 4);
        k := MAX_INT(IN1 := i, IN2 := n);
        END_PROGRAM""")
    plc.scan()
    assert [plc[name] for name in "nrbwk"] == [7, 1.5, True, 16, 7]


def test_a_typed_name_works_in_il_too() -> None:
    plc = plcemu.Plc("PROGRAM m VAR i : INT := 3; n : INT; END_VAR\n"
                     "LD i\nADD_INT 4\nST n\nEND_PROGRAM")
    plc.scan()
    assert plc["n"] == 7


def test_a_type_that_does_not_exist_makes_no_function() -> None:
    with pytest.raises(CompileError) as caught:
        plcemu.compile("PROGRAM m VAR n : INT; END_VAR n := ADD_INNT(1, 2); END_PROGRAM")
    assert [d.code for d in caught.value.errors] == ["P0020"]
