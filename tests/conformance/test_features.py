"""The features of the standard's tables, each a short program with what it gives, scan by scan."""

import pytest

import plcemu

MS = 1_000_000


def main(declared, body):
    return f"PROGRAM MAIN\nVAR\n{declared}\nEND_VAR\n{body}\nEND_PROGRAM\n"


def check(text, *scans, cycle="10ms"):
    """Run a text: before each scan write its inputs, after it compare its outputs."""
    plc = plcemu.Plc(text, cycle=cycle)
    for inputs, outputs in scans:
        for name, value in inputs.items():
            plc[name] = value
        plc.scan()
        assert plc.state == "RUN", plc.fault
        assert {name: plc[name] for name in outputs} == outputs


def gives(declared, body, **outputs):
    """Run a body once."""
    check(main(declared, body), ({}, outputs))


def table(*rows):
    """Parametrise a test over (declarations, body, value of x)."""
    return pytest.mark.parametrize(("declared", "body", "x"), rows)


# ---------------------------------------------------------------- common elements


@table(("x : INT;", "X := 1;", 1), ("x, iw2_Ab : INT;", "IW2_AB := 2; x := iw2_ab;", 2),
       ("x, _main, a__b : INT;", "_main := 1; x := _main + 2;", 3))
def test_table_1_and_2_characters_and_identifiers(declared, body, x):
    gives(declared.replace(", a__b", ""), body, x=x)


@table(("x : INT;", "(* a (* nested *) comment \u00e9 *) x := (**) 1;", 1),
       ("x : INT;", "{ pragma } x := 1;", 1), ("x : INT;", "// to the end\nx := 1;", 1),
       ("x : INT;", "/* as in C */ x := 1;", 1))
def test_table_3_comments_and_pragmas(declared, body, x):
    gives(declared, body, x=x)


@table(("x : INT;", "x := -12;", -12), ("x : DINT;", "x := 123_456;", 123456),
       ("x : INT;", "x := +986;", 986), ("x : LREAL;", "x := -12.0;", -12.0),
       ("x : LREAL;", "x := 3.14159_26;", 3.1415926), ("x : LREAL;", "x := -1.34E-12;", -1.34e-12),
       ("x : LREAL;", "x := 1.0e+6;", 1e6), ("x : BYTE;", "x := 2#1111_1111;", 255),
       ("x : BYTE;", "x := 8#340;", 224), ("x : BYTE;", "x := 16#eF;", 239),
       ("x : BOOL;", "x := 1;", True), ("x : BOOL;", "x := TRUE AND NOT FALSE;", True),
       ("x : DINT;", "x := DINT#5;", 5), ("x : UINT;", "x := UINT#16#9AF;", 0x9AF),
       ("x : BOOL;", "x := BOOL#1;", True), ("x : LREAL;", "x := LREAL#2.5;", 2.5))
def test_table_4_numeric_literals(declared, body, x):
    gives(declared, body, x=x)


@table(("x : STRING;", "x := '';", ""), ("x : STRING;", "x := 'A';", "A"),
       ("x : STRING;", "x := '\"';", '"'), ("x : WSTRING;", 'x := "A\'";', "A'"),
       ("x : STRING;", "x := STRING#'OK';", "OK"), ("x : WSTRING;", 'x := WSTRING#"OK";', "OK"))
def test_table_5_strings(declared, body, x):
    gives(declared, body, x=x)


@table(("x : STRING;", "x := '$$';", "$"), ("x : STRING;", "x := '$'';", "'"),
       ("x : STRING;", "x := '$L$l$N$R$r$T$t$P';", "\n\n\n\r\r\t\t\f"),
       ("x : STRING;", "x := '$C3$7A';", "\u00c3z"), ("x : WSTRING;", 'x := "$"$00C4";', '"\u00c4'))
def test_table_6_characters_after_a_dollar(declared, body, x):
    gives(declared, body, x=x)


@table(("x : TIME;", "x := T#14ms;", 14 * MS), ("x : TIME;", "x := t#14.7s;", 14700 * MS),
       ("x : TIME;", "x := T#-14ms;", -14 * MS), ("x : TIME;", "x := T#25h15m;", 90900000 * MS),
       ("x : TIME;", "x := TIME#5d14h12m18s3.5ms;", 483138003_500_000),
       ("x : TIME;",
        "x := TIME#1m_30s_5ms;", 90005 * MS), ("x : LTIME;", "x := LTIME#1us5ns;", 1005))
def test_table_7_durations(declared, body, x):
    gives(declared, body, x=x)


@table(("x : BOOL; d : DATE;", "d := DATE#1984-06-25; x := d = D#1984-06-25;", True),
       ("x : BOOL; d : TOD;", "d := TIME_OF_DAY#15:36:55.36; x := d = tod#15:36:55.36;", True),
       ("x : BOOL; d : DT;",
        "d := DATE_AND_TIME#1984-06-25-15:36:55.36; x := d > dt#1984-06-25-15:36:55;", True))
def test_table_8_dates_and_times_of_day(declared, body, x):
    gives(declared, body, x=x)


@pytest.mark.parametrize(("of", "low", "high"), [
    ("SINT", -2**7, 2**7 - 1), ("INT", -2**15, 2**15 - 1), ("DINT", -2**31, 2**31 - 1),
    ("LINT", -2**63, 2**63 - 1), ("USINT", 0, 2**8 - 1), ("UINT", 0, 2**16 - 1),
    ("UDINT", 0, 2**32 - 1), ("ULINT", 0, 2**64 - 1)])
def test_table_10_integers_have_exact_ranges_and_wrap(of, low, high):
    gives(f"x : {of} := {high}; y : {of} := {low};", "x := x + 1; y := y - 1;", x=low, y=high)


@pytest.mark.parametrize(("of", "initial", "value"), [
    ("BOOL", "TRUE", True), ("BYTE", "16#FF", 255), ("WORD", "16#FFFF", 65535),
    ("DWORD", "16#FFFF_FFFF", 2**32 - 1), ("LWORD", "16#FFFF_FFFF_FFFF_FFFF", 2**64 - 1),
    ("REAL", "0.5", 0.5), ("LREAL", "0.1", 0.1), ("TIME", "T#1s", 1000 * MS),
    ("STRING[5]", "'hello'", "hello"), ("WSTRING[5]", '"hello"', "hello")])
def test_table_10_other_elementary_types(of, initial, value):
    gives(f"x : {of}; y : {of} := {initial};", "x := y;", x=value)


@pytest.mark.parametrize("of", ["DATE", "TIME_OF_DAY", "TOD", "DATE_AND_TIME", "DT"])
def test_table_10_dates(of):
    gives(f"a, b : {of}; x : BOOL;", "x := a = b;", x=True)


TYPES = """TYPE
  ratio : REAL := 0.5;
  name : STRING[10] := 'anon';
  wait : TIME := T#5ms;
  mode : (manual, automatic, remote) := automatic;
  percent : INT (-100..100) := 10;
  row : ARRAY [1..2, 0..1] OF INT := [1, 2(7), 4];
  pump : STRUCT on : BOOL := TRUE; speed : percent; at_ : row; END_STRUCT;
  fast_pump : pump := (speed := 90);
END_TYPE
"""


@table(("r : ratio; x : REAL;",
        "x := r;", 0.5), ("m : mode; x : BOOL;", "x := m = automatic;", True),
       ("m : mode; x : BOOL;", "m := mode#remote; x := m = remote;", True),
       ("s : name; x : STRING;", "x := s;", "anon"), ("w : wait; x : TIME;", "x := w;", 5 * MS),
       ("p : percent; x : INT;", "x := p;", 10), ("a : row; x : INT;", "x := a[1,1] + a[2,0];", 14),
       ("p : pump; x : BOOL;", "x := p.on AND p.speed = 10 AND p.at_[2,1] = 4;", True),
       ("p : fast_pump; x : INT;", "x := p.speed;", 90))
def test_table_12_to_14_declared_types_and_their_initial_values(declared, body, x):
    check(TYPES + main(declared, body), ({}, {"x": x}))


@pytest.mark.parametrize(("address", "of", "value"), [
    ("%IX2.1", "BOOL", True), ("%QX0.0", "BOOL", True), ("%MX5.7", "BOOL", True),
    ("%IB4", "BYTE", 200), ("%QW3", "INT", -5), ("%MD7", "DINT", -70000), ("%ML2", "LINT", -2**40),
    ("%MD8", "REAL", 1.5), ("%QB1", "USINT", 255)])
def test_table_15_locations(address, of, value):
    check(main(f"a AT {address} : {of}; x : {of};", "x := a;"), ({address: value}, {"x": value}))


def test_table_15_bits_without_a_size_letter():
    check(main("x : BOOL;", "x := %I1.2;"), ({"%IX1.2": True}, {"x": True}))


def test_table_16_and_17_kinds_of_variables():
    check("VAR_GLOBAL g : INT := 4; END_VAR VAR_GLOBAL CONSTANT c : INT := 100; END_VAR\n"
          "FUNCTION_BLOCK f VAR_INPUT i : INT; END_VAR VAR_OUTPUT o : INT; END_VAR\n"
          "VAR_IN_OUT io : INT; END_VAR VAR_EXTERNAL g : INT; END_VAR VAR_TEMP t : INT; END_VAR\n"
          "VAR RETAIN r : INT := 1; END_VAR\n"
          "t := t + i; o := t + g + r; io := io + 1; g := g + 1; END_FUNCTION_BLOCK\n"
          + main("p : f; x, y : INT;", "p(i := 10, io := y, o => x); x := x + c;"),
          ({}, {"x": 115, "y": 1}), ({}, {"x": 116, "y": 2}))


def test_table_17_and_18_arrays_and_initial_values():
    gives("AT %QW5 : INT := 7; l AT %QW6 : INT := 8; a : ARRAY [1..3] OF INT := [1, 2, 3];"
          "s : STRING[10] := 'spoon'; x : INT;", "x := %QW5 * 10 + l + a[3] * 100;",
          x=378, s="spoon")


def test_table_18_arrays_of_structures_and_blocks_have_initial_values():
    check(TYPES + main("p : ARRAY [0..1] OF pump := [(speed := 5), (on := FALSE)];"
                       "t : TON := (PT := T#10ms); x : BOOL;", "t(IN := TRUE, Q => x);"),
          ({}, {"x": False, "p[0].speed": 5, "p[1].on": False, "p[1].speed": 10}),
          ({}, {"x": True}))


# ---------------------------------------------------------------- functions


DOUBLE = """FUNCTION plus : INT VAR_INPUT a : INT; b : INT := 5; END_VAR
VAR_OUTPUT c : BOOL; END_VAR plus := a + b; c := plus > 10; END_FUNCTION
FUNCTION plus_il : INT VAR_INPUT a, b : INT; END_VAR
LD a
ADD b
ST plus_il
END_FUNCTION
"""


@table(("x : INT;", "x := plus(a := 1, b := 2);", 3), ("x : INT;", "x := plus(a := 1);", 6),
       ("x : INT;", "x := plus(1, 2) * plus_il(3, 4);", 21), ("x : BOOL; y : INT;",
       "y := plus(a := 9, c => x);", True))
def test_table_19a_calls_of_functions(declared, body, x):
    check(DOUBLE + main(declared, body), ({}, {"x": x}))


@table(("x : INT; e : BOOL;", "x := 7; x := plus(EN := TRUE, a := 1, ENO => e);", 6),
       ("x : BOOL; n : INT;", "n := plus(EN := FALSE, a := 1, ENO => x);", False),
       ("x : BOOL; n : INT;", "n := ADD(EN := TRUE, IN1 := 1, IN2 := 2, ENO => x);", True))
def test_table_20_en_and_eno(declared, body, x):
    check(DOUBLE + main(declared, body), ({}, {"x": x}))


@table(("x : LREAL;",
        "x := ADD(1.5, 2);", 3.5), ("x : DINT; i : INT := 9;", "x := MAX(i, DINT#70000);", 70000))
def test_table_21_overloaded_functions(declared, body, x):
    gives(declared, body, x=x)


@table(("x : INT;", "x := REAL_TO_INT(2.5);", 2), ("x : INT;", "x := REAL_TO_INT(3.5);", 4),
       ("x : INT;", "x := REAL_TO_INT(-1.6);", -2), ("x : REAL;", "x := INT_TO_REAL(-7);", -7.0),
       ("x : BYTE;",
        "x := WORD_TO_BYTE(16#1234);", 0x34), ("x : BOOL;", "x := INT_TO_BOOL(4);", True),
       ("x : INT; b : BOOL := TRUE;", "x := BOOL_TO_INT(b);", 1),
       ("x : DINT;", "x := TRUNC(-1.6);", -1), ("x : INT;", "x := REAL_TRUNC_INT(1.9);", 1),
       ("x : UINT; w : WORD := 16#8000;", "x := WORD_TO_UINT(w);", 32768),
       ("x : USINT; i : INT := -1;", "x := INT_TO_USINT(i);", 255))
def test_table_22_conversions(declared, body, x):
    gives(declared, body, x=x)


@table(("x : UINT; w : WORD := 16#1234;", "x := WORD_BCD_TO_UINT(w);", 1234),
       ("x : WORD; u : UINT := 1234;", "x := UINT_TO_BCD_WORD(u);", 0x1234))
def test_table_22_bcd(declared, body, x):
    gives(declared, body, x=x)


@table(*((f"x : LREAL; y : LREAL := {y};", f"x := {name}(y);", pytest.approx(x)) for name, y, x in [
    ("ABS", -2.5, 2.5), ("SQRT", 6.25, 2.5), ("LN", 2.718281828459045, 1.0), ("LOG", 1000.0, 3.0),
    ("EXP", 1.0, 2.718281828459045), ("SIN", 1.0, 0.8414709848), ("COS", 1.0, 0.5403023059),
    ("TAN", 1.0, 1.5574077247), ("ASIN", 1.0, 1.5707963268), ("ACOS", 0.0, 1.5707963268),
    ("ATAN", 1.0, 0.7853981634)]))
def test_table_23_functions_of_one_number(declared, body, x):
    gives(declared, body, x=x)


@table(("x : INT;", "x := ADD(1, 2, 3);", 6), ("x : INT;", "x := MUL(2, 3, 4);", 24),
       ("x : INT;", "x := SUB(1, 3);", -2), ("x : INT;", "x := DIV(-7, 2);", -3),
       ("x : INT;", "x := MOD(-7, 2);", -1), ("x : REAL;", "x := EXPT(2.0, 3);", 8.0),
       ("x : INT;", "x := MOVE(5);", 5))
def test_table_24_arithmetic_functions(declared, body, x):
    gives(declared, body, x=x)


@table(("x : BYTE; b : BYTE := 16#81;", "x := SHL(b, 1);", 2),
       ("x : BYTE; b : BYTE := 16#81;", "x := SHR(b, 1);", 0x40),
       ("x : BYTE; b : BYTE := 16#81;", "x := ROL(IN := b, N := 1);", 3),
       ("x : BYTE; b : BYTE := 16#81;", "x := ROR(b, 1);", 0xC0),
       ("x : WORD; w : WORD := 16#FFFF;", "x := SHL(w, 16);", 0))
def test_table_25_shifts(declared, body, x):
    gives(declared, body, x=x)


@table(("x : BYTE;",
        "x := AND(16#F0, 16#3C);", 0x30), ("x : BYTE;", "x := OR(16#F0, 16#0C);", 0xFC),
       ("x : BYTE; b : BYTE := 1;", "x := XOR(b, 16#FF, 2);", 0xFC),
       ("x : BYTE; b : BYTE := 1;", "x := NOT(b);", 0xFE))
def test_table_26_bitwise_functions(declared, body, x):
    gives(declared, body, x=x)


@table(("x : INT;",
        "x := SEL(G := TRUE, IN0 := 1, IN1 := 2);", 2), ("x : INT;", "x := MAX(1, 9, 4);", 9),
       ("x : INT;",
        "x := MIN(3, -1, 4);", -1), ("x : INT;", "x := LIMIT(MN := 1, IN := 9, MX := 4);", 4),
       ("x : INT;", "x := MUX(2, 10, 20, 30);", 30))
def test_table_27_selection(declared, body, x):
    gives(declared, body, x=x)


@pytest.mark.parametrize(("op", "expected"), [
    ("GT", (False, False, True)), ("GE", (False, True, True)), ("EQ", (False, True, False)),
    ("LE", (True, True, False)), ("LT", (True, False, False)), ("NE", (True, False, True))])
def test_table_28_comparisons(op, expected):
    gives("a, b, c : BOOL;", f"a := {op}(1, 2); b := {op}(2, 2); c := {op}(3, 2);",
          a=expected[0], b=expected[1], c=expected[2])


@table(("x : BOOL;", "x := GT(3, 2, 1);", True), ("x : BOOL;", "x := LE(1, 1, 0);", False))
def test_table_28_comparisons_of_many(declared, body, x):
    gives(declared, body, x=x)


@table(("x : INT;", "x := LEN('ASTRING');", 7), ("x : STRING;", "x := LEFT('ASTR', 3);", "AST"),
       ("x : STRING;",
        "x := RIGHT('ASTR', 3);", "STR"), ("x : STRING;", "x := MID('ASTR', 2, 2);", "ST"),
       ("x : STRING;", "x := CONCAT('AB', 'CD', 'E');", "ABCDE"),
       ("x : STRING;", "x := INSERT('ABC', 'XY', 2);", "ABXYC"),
       ("x : STRING;", "x := DELETE('ABXYC', 2, 3);", "ABC"),
       ("x : STRING;", "x := REPLACE('ABCDE', 'X', 2, 3);", "ABXE"),
       ("x : INT;", "x := FIND('ABCBC', 'BC');", 2))
def test_table_29_strings(declared, body, x):
    gives(declared, body, x=x)


@table(("x : TIME;",
        "x := ADD_TIME(T#1s, T#2s);", 3000 * MS), ("x : TIME;", "x := T#1s - T#3s;", -2000 * MS),
       ("x : TIME;",
        "x := MULTIME(T#2s, 2.5);", 5000 * MS), ("x : TIME;", "x := T#5s / 2;", 2500 * MS),
       ("x : BOOL;", "x := ADD_TOD_TIME(TOD#12:00:00, T#1h) = TOD#13:00:00;", True),
       ("x : BOOL;", "x := DT#2000-01-01-00:00:00 + T#1d = DT#2000-01-02-00:00:00;", True),
       ("x : TIME;", "x := SUB_DATE_DATE(D#2000-03-01, D#2000-02-28);", 172800000 * MS),
       ("x : BOOL;",
        "x := CONCAT_DATE_TOD(D#2000-01-01, TOD#01:00:00) = DT#2000-01-01-01:00:00;", True),
       ("x : BOOL;", "x := DT_TO_DATE(DT#2000-01-01-01:00:00) = D#2000-01-01;", True),
       ("x : BOOL;", "x := DT_TO_TOD(DT#2000-01-01-01:00:00) = TOD#01:00:00;", True))
def test_table_30_time(declared, body, x):
    gives(declared, body, x=x)


@table(("m, n : mode; x : BOOL;", "m := SEL(TRUE, manual, remote); x := m = remote;", True),
       ("m, n : mode; x : BOOL;", "m := MUX(0, manual, remote); x := EQ(m, manual);", True),
       ("m, n : mode; x : BOOL;", "n := remote; x := NE(m, n) AND m <> n;", True))
def test_table_31_enumerations(declared, body, x):
    check(TYPES + main(declared, body), ({}, {"x": x}))


# ---------------------------------------------------------------- function blocks


def test_table_32_inputs_and_outputs_of_instances():
    check(main("t : TON; x : BOOL; e : TIME;",
               "t.IN := TRUE; t(PT := T#20ms); x := t.Q; e := t.ET;"),
          ({}, {"x": False, "e": 0}), ({}, {"e": 10 * MS}), ({}, {"x": True, "e": 20 * MS}))


def test_table_33_edges_of_inputs():
    check("FUNCTION_BLOCK f VAR_INPUT u : BOOL R_EDGE; d : BOOL F_EDGE; END_VAR\n"
          "VAR_OUTPUT nu, nd : INT; END_VAR\n"
          "IF u THEN nu := nu + 1; END_IF; IF d THEN nd := nd + 1; END_IF; END_FUNCTION_BLOCK\n"
          + main("p : f; a : BOOL := TRUE; u, d : INT;", "p(u := a, d := a, nu => u, nd => d);"),
          ({}, {"u": 1, "d": 0}), ({}, {"u": 1, "d": 0}), ({"a": False}, {"u": 1, "d": 1}),
          ({}, {"u": 1, "d": 1}), ({"a": True}, {"u": 2, "d": 1}))


def test_table_33_instances_as_in_out_and_nested():
    check("FUNCTION_BLOCK inner VAR_OUTPUT n : INT; END_VAR n := n + 1; END_FUNCTION_BLOCK\n"
          "FUNCTION_BLOCK outer VAR_IN_OUT c : inner; END_VAR VAR own : inner; END_VAR\n"
          "VAR_OUTPUT n : INT; END_VAR c(); own(); own(); n := own.n; END_FUNCTION_BLOCK\n"
          + main("i : inner; o : outer; x, y : INT;", "o(c := i); o(c := i); x := i.n; y := o.n;"),
          ({}, {"x": 2, "y": 4}))


@pytest.mark.parametrize(("block", "both"), [("f : SR; x : BOOL;\n", True),
                                               ("f : RS; x : BOOL;\n", False)])
def test_table_34_bistable_blocks(block, both):
    first, second = ("S1", "R") if both else ("S", "R1")
    check(main(block + "s, r : BOOL;", f"f({first} := s, {second} := r); x := f.Q1;"),
          ({"s": True}, {"x": True}), ({"s": False}, {"x": True}), ({"r": True}, {"x": False}),
          ({"s": True}, {"x": both}))


def test_table_35_edges():
    check(main("a, u, d : BOOL; r : R_TRIG; f : F_TRIG;",
               "r(CLK := a); f(CLK := a); u := r.Q; d := f.Q;"),
          ({"a": True}, {"u": True, "d": False}), ({}, {"u": False, "d": False}),
          ({"a": False}, {"u": False, "d": True}), ({}, {"u": False, "d": False}))


@pytest.mark.parametrize("of", ["", "_DINT", "_LINT", "_UDINT", "_ULINT"])
def test_table_36_counters(of):
    check(main(f"u : CTU{of}; d : CTD{of}; b : CTUD{of}; a, l, qu, qd : BOOL;",
               "u(CU := a, R := FALSE, PV := 2, Q => qu); d(CD := a, LD := l, PV := 2, Q => qd);"
               "b(CU := a, CD := FALSE, R := FALSE, LD := l, PV := 5);"),
          ({"l": True}, {"qu": False, "qd": False, "d.CV": 2, "b.CV": 5}),
          ({"l": False, "a": True}, {"u.CV": 1, "d.CV": 1, "b.CV": 6}), ({"a": False}, {"u.CV": 1}),
          ({"a": True}, {"qu": True, "qd": True, "b.CV": 7}))


@pytest.mark.parametrize(("block", "line"), [("TON", "__--_"), ("TP", "--___"), ("TOF", "-----")])
def test_table_37_and_38_timers(block, line):
    plc = plcemu.Plc(main(f"t : {block}; a, x : BOOL;", "t(IN := a, PT := T#20ms, Q => x);"))
    found = ""
    for a in (True, True, True, True, False):
        plc["a"] = a
        plc.scan()
        found += "-" if plc["x"] else "_"
    assert found == line


# ---------------------------------------------------------------- SFC


CHART = """INITIAL_STEP one:
  lamp(N); act(P1);
END_STEP
TRANSITION FROM one TO two := go; END_TRANSITION
STEP two: held(S); act(N); END_STEP
TRANSITION named FROM two TO three : LD go
END_TRANSITION
STEP three: held(R); late(D, T#20ms); END_STEP
TRANSITION FROM three TO one := three.T >= T#30ms; END_TRANSITION
ACTION act:
  LD n
  ADD 1
  ST n
END_ACTION"""


def test_tables_40_to_44_steps_transitions_and_actions():
    check(main("lamp, held, late, go : BOOL; n : INT;", CHART),
          ({}, {"lamp": True, "n": 1, "one.X": True}), ({}, {"n": 1, "one.T": 10 * MS}),
          ({"go": True}, {"lamp": False, "held": True, "n": 2, "two.X": True}),
          ({}, {"held": False, "three.X": True, "late": False}), ({}, {"late": False}),
          ({"go": False}, {"late": True}), ({}, {"late": False, "one.X": True}))


@pytest.mark.parametrize(("qualifier", "line"), [
    ("N", "_---____"), ("S", "_-------"), ("L, T#20ms", "_--_____"), ("D, T#20ms", "___-____"),
    ("P", "_-______"), ("P1", "_-______"), ("P0", "____-___"), ("SD, T#40ms", "_____---"),
    ("DS, T#20ms", "___-----"), ("SL, T#40ms", "_----___")])
def test_table_45_qualifiers(qualifier, line):
    plc = plcemu.Plc(main("n : INT; q, x : BOOL;", f"""INITIAL_STEP idle: END_STEP
    TRANSITION FROM idle TO on := TRUE; END_TRANSITION
    STEP on: q({qualifier}); END_STEP
    TRANSITION FROM on TO off := on.T >= T#30ms; END_TRANSITION
    STEP off: END_STEP"""))
    found = ""
    for _ in range(8):
        plc.scan()
        found += "-" if plc["q"] else "_"
    assert found == line


def test_table_45_r_ends_what_s_began():
    check(main("q, go : BOOL;", "INITIAL_STEP a: q(S); END_STEP STEP b: q(R); END_STEP\n"
               "TRANSITION FROM a TO b := go; END_TRANSITION "
               "TRANSITION FROM b TO a := go; END_TRANSITION"),
          ({}, {"q": True}), ({"go": True}, {"q": False}), ({}, {"q": True}))


def test_table_46_selection_takes_one_branch_and_simultaneous_sequences_all():
    check(main("x, y, z : BOOL; go : BOOL;", """INITIAL_STEP a: END_STEP
    TRANSITION (PRIORITY := 2) FROM a TO b := go; END_TRANSITION
    TRANSITION (PRIORITY := 1) FROM a TO (c, d) := go; END_TRANSITION
    STEP b: x(N); END_STEP STEP c: y(N); END_STEP STEP d: z(N); END_STEP
    TRANSITION FROM (c, d) TO a := go; END_TRANSITION
    TRANSITION FROM b TO a := go; END_TRANSITION"""),
          ({}, {"x": False, "y": False, "z": False}),
          ({"go": True}, {"x": False, "y": True, "z": True}),
          ({}, {"a.X": True, "y": False, "z": False}))


# ---------------------------------------------------------------- configuration


def test_tables_49_and_50_configuration_and_tasks():
    plc = plcemu.Plc("PROGRAM p VAR n : INT; END_VAR n := n + 1; END_PROGRAM\n"
                     "CONFIGURATION c VAR_GLOBAL g : INT := 3; END_VAR\nRESOURCE r ON cpu\n"
                     "TASK fast (INTERVAL := T#10ms, PRIORITY := 1);\n"
                     "TASK slow (INTERVAL := T#50ms, PRIORITY := 2);\n"
                     "PROGRAM one WITH fast : p; PROGRAM two WITH slow : p;\n"
                     "END_RESOURCE END_CONFIGURATION")
    plc.run_for("100ms")
    assert (plc["one.n"], plc["two.n"], plc["g"]) == (10, 2, 3)


# ---------------------------------------------------------------- IL


IL = "a : BOOL := TRUE; b, x : BOOL; i : INT := 7; n : INT; t : TON; c : CTU;"


@pytest.mark.parametrize(("body", "name", "value"), [
    ("LD a\nST x", "x", True), ("LDN a\nSTN x", "x", True), ("LD a\nS x", "x", True),
    ("LD a\nST x\nR x", "x", False), ("LD a\nAND b\nSTN x", "x", True),
    ("LD a\n& a\nST x", "x", True),
    ("LD a\nANDN b\nST x", "x", True), ("LD b\nOR a\nST x", "x", True),
    ("LD b\nORN b\nST x", "x", True),
    ("LD a\nXOR a\nST x", "x", False), ("LD a\nXORN a\nST x", "x", True),
    ("LD b\nNOT\nST x", "x", True),
    ("LD i\nADD 3\nST n", "n", 10), ("LD i\nSUB 3\nST n", "n", 4), ("LD i\nMUL 3\nST n", "n", 21),
    ("LD i\nDIV 3\nST n", "n", 2), ("LD i\nMOD 3\nST n", "n", 1), ("LD i\nGT 6\nST x", "x", True),
    ("LD i\nGE 7\nST x", "x", True), ("LD i\nEQ 7\nST x", "x", True),
    ("LD i\nNE 7\nST x", "x", False),
    ("LD i\nLE 7\nST x", "x", True), ("LD i\nLT 7\nST x", "x", False),
    ("LD 1\nJMP l\nl: LD 5\nST n", "n", 5), ("LD a\nJMPC l\nLD 5\nST n\nl: LD a\nST x", "n", 0),
    ("LD a\nJMPCN l\nLD 5\nST n\nl: LD a\nST x", "n", 5), ("LD a\nRETC\nST x", "x", False),
    ("LD b\nRETC\nLD a\nST x", "x", True), ("RET\nLD a\nST x", "x", False)])
def test_table_52_operators_of_il(body, name, value):
    gives(IL, body, **{name: value})


@pytest.mark.parametrize("body", ["LD a\nAND(\nLD b\nOR a\n)\nST x", "LD a\nAND( b\nOR a\n)\nST x",
                                  "LD b\nOR( a\nAND( b\nORN b\n)\n)\nST x"])
def test_table_51a_parentheses(body):
    gives(IL, body, x=True)


@pytest.mark.parametrize("call", [
    "CAL c(CU := a, R := b, PV := 1)", "CAL c(\nCU := a,\nR := b,\nPV := 1\n)", "CAL c(a, b, 1)",
    "LD a\nST c.CU\nLD b\nST c.R\nLD 1\nST c.PV\nCAL c", "LD a\nCALC c(CU := a, PV := 1)",
    "LD b\nCALCN c(CU := a, PV := 1)"])
def test_table_53_calls_of_blocks(call):
    gives(IL, f"{call}\nLD c.Q\nST x\nLD c.CV\nST n", x=True, n=1)


@pytest.mark.parametrize(("body", "n"), [
    ("LD 1\nPV c\nLD a\nCU c\nLD c.CV\nST n", 1)])
def test_table_54_input_operators(body, n):
    gives(IL, body, n=n)


@pytest.mark.parametrize("call", ["LD 3\nplus 4\nST n", "plus(\na := 3,\nb := 4\n)\nST n"])
def test_table_53_calls_of_functions(call):
    check(DOUBLE + main(IL, call), ({}, {"n": 7}))


# ---------------------------------------------------------------- ST


@table(("x : INT;", "x := (2 + 3) * 4;", 20), ("x : INT;", "x := MAX(2, 3) * 4;", 12),
       ("x : REAL;",
        "x := 2.0 * 3.0 ** 2.0;", 18.0), ("x : REAL; r : REAL := 2.0;", "x := -r ** 2.0;", 4.0),
       ("x : INT; i : INT := 2;",
        "x := -i + 1;", -1), ("x : BOOL; a : BOOL;", "x := NOT a OR a;", True),
       ("x : INT;", "x := 7 * 2 / 3 MOD 3;", 1), ("x : INT;", "x := 1 - 2 + 4;", 3),
       ("x : BOOL;", "x := 1 < 2 = TRUE;", True), ("x : BOOL;", "x := 1 <> 2 AND 2 >= 2;", True),
       ("x : BOOL;", "x := TRUE OR FALSE & FALSE;", True),
       ("x : BOOL;", "x := TRUE XOR TRUE AND FALSE;", True),
       ("x : BOOL;", "x := TRUE OR TRUE XOR TRUE;", True))
def test_table_55_operators_of_st(declared, body, x):
    gives(declared, body, x=x)


@table(("x : INT;", "x := 5;", 5), ("x : BOOL; t : R_TRIG;", "t(CLK := TRUE); x := t.Q;", True),
       ("x : INT;", "x := 1; RETURN; x := 2;", 1),
       ("x : INT;", "IF x > 0 THEN x := 1; ELSIF x = 0 THEN x := 2; ELSE x := 3; END_IF;", 2),
       ("x : INT := 4;", "CASE x OF 1, 2: x := 10; 3..5: x := 20; ELSE x := 30; END_CASE;", 20),
       ("x, i : INT;", "FOR i := 10 TO 1 BY -3 DO x := x + i; END_FOR;", 22),
       ("x : INT;", "WHILE x < 5 DO x := x + 2; END_WHILE;", 6),
       ("x : INT;", "REPEAT x := x + 2; UNTIL x >= 1 END_REPEAT;", 2),
       ("x, i : INT;", "FOR i := 1 TO 9 DO IF i = 4 THEN EXIT; END_IF; x := i; END_FOR;", 3),
       ("x : INT := 3;", ";;;", 3))
def test_table_56_statements_of_st(declared, body, x):
    gives(declared, body, x=x)


@table(("x, i : INT;",
        "FOR i := 1 TO 5 DO IF i = 2 THEN CONTINUE; END_IF; x := x * 10 + i; END_FOR;", 1345),
       ("x, i : INT;",
        "WHILE i < 4 DO i := i + 1; IF i = 2 THEN CONTINUE; END_IF; x := x + i; END_WHILE;", 8),
       ("x, i : INT;",
        "REPEAT i := i + 1; CONTINUE; x := 9; UNTIL i = 3 END_REPEAT; x := x + i;", 3),
       ("x, continue : INT;", "continue := 3; x := continue;", 3))
def test_continue_goes_on_with_the_next_round(declared, body, x):
    gives(declared, body, x=x)
