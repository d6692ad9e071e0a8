"""Functions of character strings against Python's own (IEC 61131-3, table 29)."""

import pytest
from controller import Controller, evaluate, findings, main
from hypothesis import given, settings
from hypothesis import strategies as st

from plcemu.ir.builtins import read_string, write_string

CALLS = {
    "LEFT": ("LEFT(a, n)", lambda a, b, n, p: a[:n]),
    "RIGHT": ("RIGHT(a, n)", lambda a, b, n, p: a[max(0, len(a) - n):]),
    "MID": ("MID(a, n, p)", lambda a, b, n, p: a[p - 1:p - 1 + n]),
    "CONCAT": ("CONCAT(a, b, a)", lambda a, b, n, p: a + b + a),
    "INSERT": ("INSERT(a, b, MIN(p, LEN(a)))",
               lambda a, b, n, p: a[:min(p, len(a))] + b + a[min(p, len(a)):]),
    "DELETE": ("DELETE(a, n, p)", lambda a, b, n, p: a[:p - 1] + a[p - 1 + n:]),
    "REPLACE": ("REPLACE(a, b, n, p)", lambda a, b, n, p: a[:p - 1] + b + a[p - 1 + n:]),
    "SEL": ("SEL(n > p, a, b)", lambda a, b, n, p: b if n > p else a),
    "MUX": ("MUX(n, a, b, 'c')", lambda a, b, n, p: [a, b, "c"][min(n, 2)]),
    "MAX": ("MAX(a, b)", lambda a, b, n, p: max(a, b)),
    "MIN": ("MIN(a, b, 'm')", lambda a, b, n, p: min(a, b, "m")),
    "LIMIT": ("LIMIT('b', a, 'y')", lambda a, b, n, p: min(max(a, "b"), "y")),
}
NUMBERS = {
    "LEN": ("LEN(a)", lambda a, b: len(a)),
    "FIND": ("FIND(a, b)", lambda a, b: a.find(b) + 1 if b else 0),
}
COMPARISONS = {"<": lambda a, b: a < b, "<=": lambda a, b: a <= b, "=": lambda a, b: a == b,
               "<>": lambda a, b: a != b, ">": lambda a, b: a > b, ">=": lambda a, b: a >= b}


def program(kind):
    """Return a controller of all functions on one kind of string."""
    quote = {"STRING": "'", "WSTRING": '"'}[kind]
    body = [f"r{k} := {text};".replace("'", quote) for k, (text, _) in CALLS.items()]
    body += [f"n{k} := {text};" for k, (text, _) in NUMBERS.items()]
    body += [f"c{n} := a {op} b;" for n, op in enumerate(COMPARISONS)]
    names = ", ".join("r" + k for k in CALLS)
    counts = ", ".join("n" + k for k in NUMBERS)
    flags = ", ".join(f"c{n}" for n in range(len(COMPARISONS)))
    return Controller(main(f"a, b : {kind}[30]; n, p : INT; {names} : {kind}[99]; "
                           f"{counts} : INT; {flags} : BOOL;", "\n".join(body)))


PROGRAMS = {kind: program(kind) for kind in ("STRING", "WSTRING")}
SHORT = st.text("abc", max_size=6)
TEXTS = {"STRING": st.text(st.characters(max_codepoint=255), max_size=30) | SHORT,
         "WSTRING": st.text(st.characters(max_codepoint=0xD7FF), max_size=30) | SHORT}


@pytest.mark.parametrize("kind", PROGRAMS)
@given(data=st.data(), n=st.integers(0, 40), p=st.integers(1, 40))
@settings(max_examples=100, deadline=None)
def test_string_functions_do_what_python_does(kind, data, n, p):
    plc = PROGRAMS[kind]
    a, b = data.draw(TEXTS[kind]), data.draw(TEXTS[kind])
    plc["a"], plc["b"], plc["n"], plc["p"] = a, b, n, p
    plc.scan()
    assert plc.resource.fault is None
    assert {k: plc["r" + k] for k in CALLS} == {k: fn(a, b, n, p) for k, (_, fn) in CALLS.items()}
    assert {k: plc["n" + k] for k in NUMBERS} == {k: fn(a, b) for k, (_, fn) in NUMBERS.items()}
    assert [plc[f"c{i}"] for i in range(6)] == [fn(a, b) for fn in COMPARISONS.values()]


@pytest.mark.parametrize(("call", "value"), [
    ("LEFT(IN := s, L := 2)", "he"), ("RIGHT(L := 2, IN := s)", "lo"),
    ("MID(IN := s, L := 3, P := 2)", "ell"), ("CONCAT(IN1 := s, IN2 := '!')", "hello!"),
    ("CONCAT(IN1 := s, IN2 := '!', IN3 := s)", "hello!hello"),
    ("INSERT(IN1 := s, IN2 := '-', P := 2)", "he-llo"), ("DELETE(IN := s, L := 2, P := 1)", "llo"),
    ("REPLACE(IN1 := s, IN2 := 'x', L := 4, P := 1)", "xo"),
    ("CONCAT(CONCAT(s, ','), CONCAT(s, '.'))", "hello,hello."),
    ("LEFT(RIGHT(MID(s, 4, 1), 3), 2)", "el"),
])
def test_formal_names_and_nested_calls(call, value):
    assert evaluate("s : STRING := 'hello'; r : STRING;", f"r := {call};", "r") == value


def test_a_string_may_be_built_from_itself():
    assert evaluate("s : STRING := 'ab'; i : INT;",
                    "FOR i := 1 TO 3 DO s := CONCAT(s, '-', s); END_FOR;", "s") \
        == "-".join(["ab"] * 8)


def test_assignment_cuts_to_the_capacity_of_the_target():
    assert evaluate("s : STRING[4] := 'abcd'; r : STRING[6];", "r := CONCAT(s, s);", "r") \
        == "abcdab"


def test_a_string_of_user_functions_stays_while_they_are_called_again():
    text = """FUNCTION Twice : STRING[20]
VAR_INPUT s : STRING[10]; END_VAR
Twice := CONCAT(s, s);
END_FUNCTION
""" + main("r : STRING;", "r := CONCAT(Twice('ab'), Twice('cd'), Twice(LEFT('xyz', 1)));")
    assert Controller(text).scan()["r"] == "ababcdcdxx"


def test_len_takes_the_integer_type_around_it():
    assert evaluate("s : STRING := 'abc'; r : ULINT;", "r := LEN(s) * 3_000_000_000;", "r") \
        == 9_000_000_000
    assert evaluate("s : STRING := 'abc'; r : REAL;", "r := LEN(s) / 2.0;", "r") == 1.5


@pytest.mark.parametrize(("body", "found"), [
    ("s := LEFT(s, 'a');", "5:14: P0023"), ("s := LEFT(5, 1);", "5:11: P0023"),
    ("s := CONCAT(s, w);", "5:16: P0023"), ("i := LEN(i);", "5:10: P0023"),
    ("s := CONCAT(s);", "5:6: P0026"), ("s := LEFT(s, 1.5);", "5:14: P0023"),
    ("w := LEFT(s, 1);", "5:6: P0023"), ("s := LEFT(IN := s, N := 1);", "5:6: P0026"),
])
def test_wrong_arguments_are_reported_at_their_place(body, found):
    assert findings(main("s : STRING; w : WSTRING; i : INT;", body)) == [found]


@pytest.mark.parametrize(("call", "reason"), [
    ("MID(s, 1, 0)", "the position in MID is 0"), ("LEFT(s, -1)", "the length in LEFT is -1"),
    ("RIGHT(s, -1)", "the length in RIGHT is -1"), ("DELETE(s, 1, 0)", "the position in DELETE"),
    ("INSERT(s, s, 4)", "the position in INSERT is 4"),
    ("REPLACE(s, s, 1, -2)", "in REPLACE is -2"),
])
def test_a_position_outside_of_the_string_is_a_fault_with_its_reason(call, reason):
    plc = Controller(main("s : STRING := 'abc'; r : STRING;", f"r := {call};")).scan()
    assert reason in str(plc.resource.fault)


def test_a_wstring_counts_code_units_of_utf_16():
    assert evaluate("s : WSTRING := \"$D83D$DE00\"; r : INT;", "r := LEN(s);", "r") == 2
    assert evaluate("s : WSTRING := \"a$D83D$DE00\"; r : WSTRING;", "r := RIGHT(s, 2);", "r") \
        == "\U0001f600"


@given(st.text(max_size=20), st.integers(0, 12))
def test_what_is_written_as_a_wstring_reads_back_up_to_the_capacity(text, capacity):
    block = bytearray(100)
    write_string(block, 4, capacity, text, "w")
    data = text.encode("utf-16-le")[:capacity * 2]
    assert read_string(block, 4, "w").encode("utf-16-le", "surrogatepass") == data
