"""Located arrays, structures and strings, retained variables, VAR_TEMP, types (2.4.1.1, 2.4.3)."""

import pytest
from controller import Controller, evaluate, findings, main

from plcemu.lang.compile import compile_program

TYPES = """
TYPE Record : STRUCT a : INT := 4; d : DINT; list : ARRAY[0..1] OF INT := [1, 2]; END_STRUCT;
     Flags : STRUCT x, y : BOOL; more : ARRAY[1..3] OF BOOL := [FALSE, TRUE]; END_STRUCT;
     Mixed : STRUCT a : INT; x : BOOL; END_STRUCT; Colour : (RED, GREEN, BLUE) := BLUE; END_TYPE
"""


def program(declared, body=""):
    return Controller(TYPES + main(declared + " i : INT := 1;", body + " i := i;"))


# ---------------------------------------------------------------- arrays


def test_an_array_takes_the_elements_from_its_address_on():
    controller = program("a AT %MW10 : ARRAY[1..3] OF INT := [7, 8, 9]; w AT %MW11 : INT;",
                         "a[i] := a[3]; %MW12 := 5;").scan()
    assert [controller[f"a[{n}]"] for n in (1, 2, 3)] == [9, 8, 5]
    assert controller["w"] == 8


def test_the_elements_of_an_array_have_their_addresses_as_tags():
    tags = program("a AT %MD4 : ARRAY[0..1, 0..1] OF DINT;").resource.memory.tags
    assert [t.address for t in tags if t.name.startswith("MAIN.a")] == ["%MD4", "%MD5", "%MD6",
                                                                        "%MD7"]


def test_an_array_of_bool_crosses_bytes():
    controller = program("a AT %QX0.6 : ARRAY[0..3] OF BOOL; b AT %QX1.1 : BOOL;",
                         "a[i + 2] := TRUE; a[0] := TRUE;").scan()
    assert [t.address for t in controller.resource.memory.tags if t.address] == [
        "%QX0.6", "%QX0.7", "%QX1.0", "%QX1.1", "%QX1.1"]
    assert (controller["%QX0.6"], controller["b"]) == (True, True)


def test_a_located_array_lies_in_one_extent_of_the_image():
    extents = compile_program(main("a AT %MW100 : ARRAY[0..299] OF INT; i : INT;",
                                   "a[i] := i; %MW399 := 5; %MW250 := 6;")).layout.extents
    assert [(e.area, e.first, e.count) for e in extents] == [("MW", 100, 300)]


def test_overlapping_arrays_share_their_elements():
    controller = program("a AT %MW0 : ARRAY[0..9] OF INT; b AT %MW5 : ARRAY[0..9] OF INT;",
                         "a[5] := 3; b[4] := 8;").scan()
    assert (controller["b[0]"], controller["a[9]"]) == (3, 8)


def test_global_arrays_have_addresses_and_named_limits():
    controller = Controller(
        "VAR_GLOBAL CONSTANT n : INT := 3; END_VAR\n"
        "VAR_GLOBAL g AT %QW0 : ARRAY[1..n] OF INT; END_VAR\n"
        "PROGRAM MAIN VAR_EXTERNAL g : ARRAY[1..3] OF INT; END_VAR g[2] := 6; END_PROGRAM").scan()
    assert (controller["%QW1"], controller["g[2]"]) == (6, 6)


def test_an_array_may_reach_the_last_element_and_not_beyond():
    assert program("a AT %MW1020 : ARRAY[0..3] OF INT;").scan()["a[3]"] == 0
    assert findings(main("a AT %MW1021 : ARRAY[0..3] OF INT;", "a[0] := 1;")) == ["3:6: P0030"]
    assert findings(main("a AT %MX1023.7 : ARRAY[0..1] OF BOOL;", "a[0] := TRUE;")) == [
        "3:6: P0030"]


def test_a_whole_area_of_bits_can_be_one_array():
    controller = program("a AT %MX0.0 : ARRAY[0..8191] OF BOOL; b AT %MX1023.7 : BOOL;",
                         "a[8190 + i] := TRUE;").scan()
    assert controller["b"] is True


# ---------------------------------------------------------------- structures, strings, enumerations


def test_a_structure_takes_contiguous_elements_with_its_own_initial_values():
    controller = program("r AT %MW20 : Record;", "r.d := 70000; r.list[i] := 9;").scan()
    assert [controller[f"MAIN.r.{f}"] for f in ("a", "d", "list[0]", "list[1]")] == [4, 70000, 1, 9]
    assert controller.resource.memory.tags["MAIN.r.list[0]"].address == "%MW24"
    assert controller.resource.memory.tags["MAIN.r.d"].address == ""


def test_an_array_of_structures_can_be_located():
    controller = program("r AT %MB0 : ARRAY[0..1] OF Record;", "r[i].a := 6; r[0] := r[1];").scan()
    assert (controller["r[0].a"], controller["r[1].list[1]"]) == (6, 2)


def test_a_structure_of_bits_stands_in_an_area_of_bits():
    controller = program("f AT %QX1.0 : Flags;", "f.y := TRUE; f.more[3] := TRUE;").scan()
    tags = [t for t in controller.resource.memory.tags if t.name.startswith("MAIN.f.")]
    assert all(t.address for t in tags)
    assert [controller[t.name] for t in tags] == [False, True, False, True, True]


def test_a_string_stands_in_bytes_behind_its_length():
    controller = program("s AT %MB0 : STRING[6] := 'abc'; b AT %MB2 : BYTE;").scan()
    assert (controller["s"], controller["b"], controller["%MB0"]) == ("abc", 0x61, 3)


def test_the_initial_value_of_a_type_holds_for_a_located_variable():
    controller = program("c AT %MD0 : Colour;").scan()
    assert controller["c"] == 2


@pytest.mark.parametrize(("declared", "code"), [
    ("a AT %MW0 : ARRAY[0..1] OF DINT;", "P0031"), ("a AT %MW0 : ARRAY[0..1] OF BOOL;", "P0031"),
    ("a AT %MX0.0 : ARRAY[0..1] OF BYTE;", "P0031"), ("a AT %MW0 : Mixed;", "P0031"),
    ("a AT %MX0.0 : Mixed;", "P0031"), ("a AT %MX0.0 : STRING;", "P0031"),
    ("a AT %MW0 : TON;", "P0031"), ("a AT %MW0 : BOOL;", "P0031"), ("a AT %I* : BOOL;", "P0090"),
    ("a AT %QW* : ARRAY[0..1] OF INT;", "P0090"), ("a AT %MW2000 : INT;", "P0030"),
    ("a AT %MB1000 : STRING[40];", "P0030"),
])
def test_what_does_not_fit_an_address_is_told_once(declared, code):
    text = TYPES + main(declared, "")
    assert [f[-5:] for f in findings(text) if f[-5:] not in ("P0070", "P0072")] == [code]


# ---------------------------------------------------------------- retained


def test_retained_variables_reach_the_layout_with_their_places():
    layout = compile_program(
        TYPES + "FUNCTION_BLOCK F VAR RETAIN total : DINT; END_VAR VAR n : INT; END_VAR\n"
        "total := total + 1; n := n; END_FUNCTION_BLOCK\n"
        "VAR_GLOBAL RETAIN g : INT := 3; END_VAR\n"
        "PROGRAM MAIN VAR RETAIN a : INT; r : Record; q AT %MW7 : INT; END_VAR\n"
        "VAR f : F; list : ARRAY[0..1] OF F; b : INT; END_VAR VAR_EXTERNAL g : INT; END_VAR\n"
        "f(); list[0](); a := g; b := a; r.a := q; q := b; END_PROGRAM").layout
    assert [(r.name, r.type, r.size) for r in layout.retained] == [
        ("g", "INT", 2), ("MAIN.q", "INT", 2), ("MAIN.a", "INT", 2), ("MAIN.r", "Record", 16),
        ("MAIN.f.total", "DINT", 4), ("MAIN.list[0].total", "DINT", 4),
        ("MAIN.list[1].total", "DINT", 4)]
    offsets = {s.tag.name: s.offset for s in layout.slots}
    assert [r.offset for r in layout.retained if r.name in offsets] == [
        offsets[r.name] for r in layout.retained if r.name in offsets]


def test_a_program_without_retain_retains_nothing():
    assert compile_program(main("a : INT;", "a := a;")).layout.retained == ()


# ---------------------------------------------------------------- VAR_TEMP


def test_temporaries_of_any_type_begin_anew_at_every_call():
    controller = Controller(TYPES + """
        FUNCTION_BLOCK F VAR_OUTPUT n : INT; text : STRING; END_VAR
        VAR_TEMP r : Record; a : ARRAY[1..2] OF INT := [10, 20]; s : STRING := 'x'; END_VAR
        n := n + r.a + a[2]; text := s; r.a := 100; a[2] := 100; s := 'changed';
        END_FUNCTION_BLOCK
        PROGRAM MAIN VAR f : F; END_VAR f(); END_PROGRAM""")
    assert controller.values(3, "f.n") == [24, 48, 72]
    assert controller["f.text"] == "x"


def test_temporaries_are_no_tags_and_not_seen_from_outside():
    text = TYPES + ("FUNCTION_BLOCK F VAR_TEMP r : Record; END_VAR r.a := 1; END_FUNCTION_BLOCK\n"
                    "PROGRAM MAIN VAR f : F; i : INT; END_VAR f(); {} END_PROGRAM")
    names = [s.tag.name for s in compile_program(text.format("i := i;")).layout.slots]
    assert names == ["MAIN.i"]
    assert [f[-5:] for f in findings(text.format("i := f.r.a;"))] == ["P0020"]


def test_a_program_with_structured_temporaries_becomes_quiet():
    controller = Controller(TYPES + "PROGRAM MAIN VAR_TEMP r : Record; END_VAR\n"
                            "VAR i : INT; END_VAR r.a := 9; i := r.a; END_PROGRAM").scan(3)
    assert controller.resource.is_quiet()


@pytest.mark.parametrize("section", ["VAR_TEMP", "VAR_INPUT", "VAR_OUTPUT"])
def test_function_blocks_in_other_sections_than_var_are_told(section):
    text = f"PROGRAM MAIN {section} t : TON; END_VAR t(); END_PROGRAM"
    assert [f[-5:] for f in findings(text)] == ["P0090"]


# ---------------------------------------------------------------- types


def test_initial_values_nest_through_arrays_and_structures():
    controller = Controller("""
        TYPE Inner : STRUCT x : INT := 9; y : ARRAY[1..2] OF INT := [2(3)]; END_STRUCT;
             Outer : STRUCT a : ARRAY[0..1] OF Inner := [(x := 1, y := [7, 8]), (x := 2)];
             END_STRUCT;
             Grid : ARRAY[0..1] OF ARRAY[0..2] OF INT := [[1, 2, 3], [4, 5, 6]]; END_TYPE
        PROGRAM MAIN VAR g : Grid; s : Outer; i : INT := 1; r : INT;
          t : ARRAY[1..2] OF Outer := [2((a := [(y := [1, 1]), (x := 5)]))]; END_VAR
        r := g[i][2] * 100 + t[2].a[i].x * 10 + s.a[0].y[2]; END_PROGRAM""").scan()
    assert controller["r"] == 658
    assert [controller[n] for n in ("s.a[1].x", "s.a[1].y[1]", "t[1].a[0].x", "t[1].a[0].y[2]")] \
        == [2, 3, 9, 1]


def test_arrays_and_structures_of_arrays_are_assigned_as_a_whole():
    assert evaluate("a, b : ARRAY[0..1] OF ARRAY[0..1] OF INT; x : INT;",
                    "a[1][0] := 5; b[0] := a[1]; x := b[0][0];", "x") == 5


@pytest.mark.parametrize(("body", "codes"), [
    ("p := 100; p := 0;", []), ("p := 101;", ["P0025"]), ("p := -1;", ["P0025"]),
    ("p := 50 + 5;", []), ("p := n;", []), ("r := 0;", ["P0025"]), ("r := 10;", []),
])
def test_constants_outside_a_subrange_are_told(body, codes):
    text = ("TYPE Percent : INT(0..100); END_TYPE PROGRAM MAIN VAR p : Percent; r : INT(1..10);"
            f" n : INT; END_VAR {body} END_PROGRAM")
    assert [f[-5:] for f in findings(text) if f[-5:] not in ("P0070", "P0072")] == codes


def test_a_value_outside_a_subrange_is_not_caught_while_the_program_runs():
    assert evaluate("p : INT(0..100); n : INT := 500;", "p := n;", "p") == 500


ENUMS = "TYPE E : (RED, GREEN := 5, BLUE); F : (BLUE, YELLOW); END_TYPE\n"


def test_enumerations_compare_select_and_bound_arrays():
    controller = Controller(ENUMS + """
        PROGRAM MAIN VAR e : E := GREEN; f : F; x : BOOL; n : INT;
          a : ARRAY[0..GREEN] OF INT; END_VAR
        e := E#BLUE; f := F#YELLOW; x := e = E#BLUE AND f <> F#BLUE;
        CASE e OF RED: n := 1; GREEN..E#BLUE: n := 2; END_CASE; a[5] := n; END_PROGRAM""").scan()
    assert [controller[n] for n in ("e", "f", "x", "a[5]")] == [6, 1, True, 2]


def test_a_name_of_two_enumerations_takes_its_type_in_front():
    with pytest.raises(Exception) as caught:
        compile_program(ENUMS + "PROGRAM MAIN VAR f : F := BLUE; END_VAR f := f; END_PROGRAM")
    assert caught.value.diagnostics[0].hint.startswith("write F#BLUE")


@pytest.mark.parametrize("of", [
    "ARRAY[0..999999] OF INT", "ARRAY[0..999] OF ARRAY[0..999] OF INT",
    "ARRAY[0..999, 0..999] OF INT", "ARRAY[1..500000] OF DINT := [500000(7)]",
])
def test_an_array_of_a_million_elements_compiles_and_has_no_tags_for_them(of):
    assert len(compile_program(main(f"a : {of}; i : INT;", "i := i + 1;")).layout.slots) == 1


def test_arrays_up_to_1024_elements_have_tags():
    def count(of):
        return len(compile_program(main(f"a : {of}; i : INT;", "i := i + 1;")).layout.slots) - 1

    assert [count("ARRAY[1..1024] OF INT"), count("ARRAY[1..1025] OF INT"),
            count("ARRAY[1..32] OF ARRAY[1..32] OF INT"),
            count("ARRAY[1..32] OF ARRAY[1..33] OF INT")] == [1024, 0, 1024, 0]
