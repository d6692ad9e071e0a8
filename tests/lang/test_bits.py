"""Bits of integers and bit strings, read and written by number."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

import plcemu
from plcemu.base.errors import CompileError

WIDTHS = {"BYTE": 8, "WORD": 16, "DWORD": 32, "LWORD": 64, "USINT": 8, "UINT": 16, "UDINT": 32,
          "ULINT": 64}
SIGNED = {"SINT": 8, "INT": 16, "DINT": 32, "LINT": 64}


@pytest.mark.parametrize(("of", "bits"), [*WIDTHS.items(), *SIGNED.items()])
@given(data=st.data())
def test_a_bit_is_read_and_written_alone(of: str, bits: int, data: st.DataObject) -> None:
    bit = data.draw(st.integers(0, bits - 1))
    low = -(1 << bits - 1) if of in SIGNED else 0
    before = data.draw(st.integers(low, low + (1 << bits) - 1))
    plc = plcemu.Plc(f"""PROGRAM m VAR w : {of}; v : {of}; read, new : BOOL; END_VAR
        read := w.{bit}; v := w; v.%X{bit} := new; END_PROGRAM""")
    plc["w"], plc["new"] = before, data.draw(st.booleans())
    plc.scan()
    pattern = before & (1 << bits) - 1
    assert plc["read"] == bool(pattern >> bit & 1)
    wanted = pattern & ~(1 << bit) | plc["new"] << bit
    assert plc["v"] & (1 << bits) - 1 == wanted


def test_bits_stand_in_fields_elements_temporaries_and_il() -> None:
    plc = plcemu.Plc("""TYPE s : STRUCT w : WORD; END_STRUCT; END_TYPE
        PROGRAM m VAR a : ARRAY [0..3] OF BYTE; x : s; i : INT := 2; q : BOOL; END_VAR
        VAR_TEMP t : INT; END_VAR
        a[i].7 := TRUE; x.w.0 := a[2].7; t.15 := x.w.0; q := t < 0; END_PROGRAM
        PROGRAM n VAR w : WORD; END_VAR
        LD TRUE
        ST w.4
        S w.%X5
        LD w.4
        AND w.5
        R w.5
        END_PROGRAM""")
    plc.scan()
    assert (plc["m.a[2]"], plc["m.x.w"], plc["m.q"], plc["n.w"]) == (0x80, 1, True, 0x10)


@pytest.mark.parametrize(("text", "code"), [
    ("w.16 := TRUE;", "P0025"), ("r.1 := TRUE;", "P0023"), ("f(x := w.1);", "P0024"),
    ("w.1.1 := TRUE;", "P0010"), ("w.1 := 5;", "P0023")])
def test_a_mistake_about_a_bit_has_its_code(text: str, code: str) -> None:
    with pytest.raises(CompileError) as caught:
        plcemu.compile("FUNCTION_BLOCK fb VAR_IN_OUT x : BOOL; END_VAR x := TRUE; "
                       "END_FUNCTION_BLOCK "
                       f"PROGRAM m VAR w : WORD; r : REAL; f : fb; END_VAR {text} END_PROGRAM")
    assert [d.code for d in caught.value.errors] == [code]
