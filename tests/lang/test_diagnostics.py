"""Every kind of mistake gives exactly its diagnostics, at the exact place, and no other."""

from pathlib import Path

import pytest
from controller import findings, main

from plcemu.base.errors import CompileError
from plcemu.lang.codes import CODES
from plcemu.lang.compile import compile_program
from plcemu.lang.cursor import NESTING_LIMIT
from plcemu.lang.lexer import SOURCE_LIMIT
from plcemu.lang.report import DIAGNOSTIC_LIMIT

IL = "x, y : BOOL; i : INT; d : DINT; t : TON;"
A = "INITIAL_STEP A: x(N); END_STEP\n"


def body(declared, text):
    """A program whose body begins at line 3."""
    return f"PROGRAM MAIN VAR (**)\n{declared} END_VAR\n{text}\nEND_PROGRAM\n"


ST_CASES = [
    ("x := ?;", ["3:6: P0001"]), ("x := x ? y;\ny := x $;", ["3:8: P0001", "4:8: P0001"]),
    ("x := größe;", ["3:8: P0001"]), ("x := \u00a0y;", ["3:6: P0001"]),
    ("x := y; (* open", ["3:9: P0002"]), ("x := y; /* open", ["3:9: P0002"]),
    ("x := y; (* (* *) open", ["3:9: P0002"]), ("x := 'abc;\nx := y;", ["3:6: P0002"]),
    ("i := 16#;", ["3:6: P0003"]), ("i := 5_;\ni := 5__0;", ["3:6: P0003", "4:6: P0003"]),
    ("i := INT#99999;", ["3:6: P0003"]), ("i := INT#3#12;", ["3:6: P0003"]),
    ("x := BOOL#2;", ["3:6: P0003"]), ("t(PT := T#5q);", ["3:9: P0003"]),
    ("x := 1.0E999 > 1.0;", ["3:6: P0003"]), ("x := REAL#nan > 1.0;", ["3:6: P0003"]),
    ("i := 8#9;", ["3:6: P0003"]), ("i := 2#2;", ["3:6: P0003"]),
    ("i := DINT#1.5;", ["3:6: P0003"]),
    ("x := ;\ny := ;", ["3:6: P0010", "4:6: P0010"]), ("x := TRUE\ny := x;", ["4:1: P0010"]),
    ("x = y;", ["3:3: P0010"]), ("x := y y;", ["3:8: P0010"]), ("5 := x;", ["3:1: P0010"]),
    ("x : 5;\ny := x;", ["3:3: P0010"]), ("EXIT; x := y;", ["3:1: P0010"]),
    ("IF x = THEN y := x; END_IF;\nx := z;", ["3:8: P0010"]),
    ("IF x y := x; END_IF;\nx := y;", ["3:6: P0010"]),
    ("WHILE x y := x; END_WHILE;", ["3:9: P0010"]),
    ("FOR i := 1 5 DO i := 5; END_FOR;\nx := ;", ["3:12: P0010", "4:6: P0010"]),
    ("CASE i OF 1: i := ; i := 2; 2: i := ; END_CASE;", ["3:19: P0010", "3:37: P0010"]),
    ("CASE i 1: i := 2; 2: i := 1; END_CASE; x := y;", ["3:8: P0010"]),
    ("IF x THEN y := x;", ["4:1: P0011"]), ("CASE i OF 1: y := x;", ["4:1: P0011"]),
    ("WHILE x DO IF y THEN y := x; END_WHILE;\nx := y;", ["3:30: P0011"]),
    ("x := y; END_IF; y := x;", ["3:9: P0011"]), ("x := (x OR (y AND x);", ["3:21: P0011"]),
    ("t(IN := x;\nx := y;", ["3:10: P0011"]),
    ("x := " + "(" * 200 + "y" + ")" * 200 + ";", [f"3:{6 + NESTING_LIMIT - 1}: P0014"]),
    ("x := " + "NOT " * 200 + "y;\ny := x;", [f"3:{6 + 4 * (NESTING_LIMIT - 1)}: P0014"]),
    ("IF x THEN\n" * 100 + "y := x;\n" + "END_IF;\n" * 100, [f"{NESTING_LIMIT + 2}:4: P0014"]),
    ("IF x THEN y := x; ENDIF;\nx := z;\nWHILE x DO y := x; END_WHILLE;\nx := z;",
     ["3:19: P0010", "5:20: P0010"]),
    ("stert := x;\nx := z AND q;", ["3:1: P0020", "4:6: P0020", "4:12: P0020"]),
    ("x := t.QQ;\ny := x.Q;", ["3:6: P0020", "4:6: P0020"]), ("t.__clock := x;", ["3:1: P0020"]),
    ("x := i;", ["3:6: P0023"]), ("i := d;", ["3:6: P0023"]), ("i := x + 1;", ["3:6: P0023"]),
    ("x := x + y;", ["3:6: P0023"]), ("x := NOT i;", ["3:6: P0023"]), ("x := -y;", ["3:6: P0023"]),
    ("x := 1 + 1;", ["3:6: P0023"]), ("i := 1.5;", ["3:6: P0023"]), ("i := TRUE;", ["3:6: P0023"]),
    ("IF i THEN x := y; END_IF;", ["3:4: P0023"]), ("x := t;", ["3:6: P0023"]),
    ("x := i + d * x > 5;", ["3:10: P0023"]), ("t(IN := i);", ["3:9: P0023"]),
    ("t(NOT ET => x);", ["3:3: P0023"]), ("t(ET => x);", ["3:3: P0023"]),
    ("x := i = T#5s;", ["3:6: P0023"]), ("CASE x OF 1: y := x; END_CASE;", ["3:6: P0023"]),
    ("FOR x := 1 TO 5 DO y := x; END_FOR;", ["3:5: P0023"]),
    ("t.Q := x;", ["3:1: P0024"]), ("t(Q => 5);", ["3:8: P0024"]),
    ("i := 32768;\nd := -2147483649;", ["3:6: P0025", "4:6: P0025"]),
    ("i := " + "9" * 99 + ";", ["3:6: P0025"]),
    ("x := i > 16#FFFF;", []), ("t(PT := T#999999999d);", ["3:9: P0025"]),
    ("t(INN := x);", ["3:3: P0026"]), ("t(IN := x, FALSE);", ["3:1: P0026"]),
    ("t(x, T#1s, 5);", ["3:12: P0026"]), ("t(QQ => x);", ["3:3: P0026"]),
    ("x(IN := y);", ["3:1: P0026"]),
    ("t(IN := x, in := y);", ["3:12: P0026"]), ("CASE i OF i: y := x; END_CASE;", ["3:11: P0027"]),
    ("x := %IX0.8 AND %FOO OR %QX2000.0;", ["3:6: P0030", "3:17: P0030", "3:25: P0030"]),
    ("x := f(5);\ny := a[1];\nx := 'abc';", ["3:6: P0020", "4:6: P0020", "5:6: P0023"]),
    ("x := 'a';", ["3:6: P0023"]), ("x := y OR GT(EN := x, IN1 := i, IN2 := 3);", ["3:11: P0090"]),
    ("\t\tx := z;", ["3:8: P0020"]), ("x := y;\r\n  x := z;\r\n", ["4:8: P0020"]),
    ("(* größe \U0001f600 *) x := z;", ["3:20: P0020"]), ("{ pragma } x := z;", ["3:17: P0020"]),
]
IL_CASES = [
    ("LD x\nSTT y\nANDD y\nST y", ["4:1: P0012", "5:1: P0012"]), ("LDD x\nST y", ["3:1: P0012"]),
    ("LD x\nSTC x\nADDN x\nNOTN\nLD( x\n)",
     ["4:1: P0013", "5:1: P0013", "6:1: P0013", "7:3: P0013"]),
    ("LD\nST x\nJMP\nLD x\nCAL\nST", ["3:1: P0013", "5:1: P0013", "7:1: P0013", "8:1: P0013"]),
    ("LD x\nST 5\nCAL 5", ["4:4: P0013", "5:5: P0013"]), ("LD x x\nST y", ["3:6: P0010"]),
    ("LD x\n)\nST y", ["4:1: P0010"]), ("LD x\nAND( )\nST y", ["4:6: P0010"]),
    ("LD x\nAND( x\nOR y\nST y", ["7:1: P0011"]),
    ("CAL t(IN := x,\nPT := T#1s\nLD x\nST y", ["5:1: P0011"]),
    ("CAL t(IN := ,\nPT := T#1s)\nLD x\nST y", ["3:13: P0010"]),
    ("LD x\nAND(\nLD y\nRET\n)\nST y", ["6:1: P0013"]),
    ("LD x\nAND(\nCAL t\n)\nST y", ["5:1: P0013"]),
    ("LD x\nAND(\nJMP l\nl: AND x\n)\nl: ST y", ["5:1: P0013", "6:1: P0013"]),
    ("LD x\n" + "AND(\nLD y\n" * 100 + ")\n" * 100 + "ST y", [f"{4 + 2 * NESTING_LIMIT}:4: P0014"]),
    ("LD stert\nAND x\nST y\nADD 5\nLD x\nST i", ["3:4: P0020", "8:1: P0023"]),
    ("LD x\nADD i\nST i\nS d\nJMPC l\nl: ADD 5\nST d", ["4:1: P0023", "6:1: P0023"]),
    ("LD d\nST i", ["4:1: P0023"]), ("LD i\nS x", ["4:1: P0023"]), ("LD i\nNOT", ["4:1: P0023"]),
    ("LD x\nAND i", ["4:1: P0023"]), ("LD i\nJMPC l\nl: LD x", ["4:1: P0023"]),
    ("LD x\nAND(\nLD i\n)", ["4:1: P0023"]), ("LD i\nSTN i", ["4:1: P0023"]),
    ("LD i\nCALC t", ["4:1: P0023"]),
    ("LD x\nJMPC l\nLD i\nl: ST x", ["5:1: P0023"]), ("LD 5\nST x", ["3:4: P0023"]),
    ("LD x\nST t.Q", ["4:4: P0024"]), ("LD 32768\nST i", ["3:4: P0025"]),
    ("LD -32769\nST i", ["3:4: P0025"]),
    ("LD x\nJMPC nowhere\nST y", ["4:6: P0040"]), ("LD x\na: ST x\nA: ST y", ["5:1: P0041"]),
    ("AND x\nST x\nOR y", ["3:1: P0042"]), ("JMP l\nl: ST x", ["4:1: P0042"]),
    ("LD x\nJMPC l\nCAL t\nl: ST y\nCAL t\nRET\nl: ST x", ["9:1: P0041"]),
]
SFC_CASES = [
    ("STEP A: x(N); END_STEP", ["3:1: P0051"]),
    (A + "TRANSITION FROM A TO BB := x; END_TRANSITION\n"
         "TRANSITION FROM (A, C) TO A := z; END_TRANSITION",
     ["4:22: P0050", "5:21: P0050", "5:32: P0020"]),
    ("INITIAL_STEP A: x(Q); x(N, T#1s);\nx(L); END_STEP",
     ["3:19: P0052", "3:28: P0053", "4:3: P0053"]),
    ("INITIAL_STEP A: x(L, 5); z(N); i(N); A(N); END_STEP",
     ["3:22: P0023", "3:26: P0054", "3:32: P0054", "3:38: P0054"]),
    (A + "STEP B: END_STEP", ["4:6: P0055"]),
    (A + "STEP A: END_STEP STEP x: END_STEP", ["4:6: P0021", "4:23: P0021"]),
    (A + "ACTION b: END_ACTION ACTION B: END_ACTION", ["4:29: P0021"]),
    (A + "ACTION b: z := 5; END_ACTION", ["4:11: P0020"]),
    (A + "ACTION b: A.X := x; END_ACTION", ["4:11: P0024"]),
    (A + "TRANSITION FROM A TO A := A; END_TRANSITION", ["4:27: P0023"]),
    (A + "TRANSITION FROM A TO A := i; END_TRANSITION\n"
         "TRANSITION FROM A TO A : LD i END_TRANSITION\n"
         "TRANSITION FROM A TO A : ST x END_TRANSITION\nTRANSITION FROM A TO A : END_TRANSITION\n"
         "TRANSITION FROM A TO A : LD i\nRET END_TRANSITION",
     ["4:27: P0023", "5:26: P0023", "6:26: P0042", "7:26: P0042", "9:1: P0023"]),
    (A.replace(";", "") + "TRANSITION FROM A TO A := x END_TRANSITION\n"
     "TRANSITION FROM A A := x; END_TRANSITION", ["3:22: P0010", "4:29: P0010", "5:19: P0010"]),
    (A + "TRANSITION (PRIO := 1) FROM A TO A := x; END_TRANSITION\n"
         "TRANSITION (PRIORITY := x) FROM A TO A := x; END_TRANSITION",
         ["4:13: P0010", "5:25: P0010"]),
    (A.replace(" END_STEP", "") + "STEP B: END_STEP\nTRANSITION FROM A TO B := x;\n"
     "TRANSITION FROM B TO A := x; END_TRANSITION\nACTION c: x := y;\n"
     "ACTION d: x := y; END_ACTION",
     ["4:1: P0010", "6:1: P0011", "8:1: P0011"]),
    (A.replace("END_", "END") + "TRANSITION FROM A TO A := x; ENDTRANSITION\n"
     "ACTION b: x := y; ENDACTION\nACTION c: LD x\nENDACTION",
     ["3:23: P0010", "4:30: P0010", "5:19: P0010", "7:1: P0010"]),
    ("INITIAL_STEP A: x(N, y, z); END_STEP", ["3:25: P0020"]),
    ("INITIAL_STEP A: x(N, i); x(L, T#1s, y, i); END_STEP", ["3:22: P0023", "3:40: P0023"]),
    (A + "ACTION b:\nSTEP C: END_STEP ACTION d: x := y; END_ACTION END_ACTION", ["5:1: P0090"]),
    (A + "TRANSITION t FROM A TO A; END_TRANSITION", ["4:1: P0020"]),
    (A + "TRANSITION t := x; END_TRANSITION TRANSITION t := y; END_TRANSITION", ["4:35: P0021"]),
    (A + "TRANSITION t FROM A TO A := x; END_TRANSITION\n"
     "TRANSITION t FROM A TO A := y; END_TRANSITION", ["5:1: P0021"]),
    (A + "STEP B: END_STEP STEP C: END_STEP TRANSITION FROM A TO (B, C) := x; END_TRANSITION\n"
     "TRANSITION FROM B TO A := y; END_TRANSITION", ["4:35: P0056"]),
    (A + "STEP B: END_STEP STEP C: END_STEP TRANSITION FROM A TO B := x; END_TRANSITION\n"
     "TRANSITION FROM A TO C := y; END_TRANSITION\n"
     "TRANSITION FROM (B, C) TO A := y; END_TRANSITION", ["6:1: P0057"]),
]
P = "INITIAL_PLACE A: x := 0; END_PLACE PLACE B: x := 1; END_PLACE\n"
T = ("TRANSITION e FROM A TO B := y; END_TRANSITION "
     "TRANSITION f FROM B TO A := NOT y; END_TRANSITION\n")
SIPN_CASES = [
    (P + T, []),
    (P + T.replace("TO B", "TO C"), ["4:24: P0110"]),
    (P.replace("INITIAL_PLACE", "PLACE") + T, ["3:7: P0111"]),
    (P + "PLACE C: END_PLACE PLACE G: x := 1; END_PLACE\n" + T, ["4:7: P0112", "4:26: P0112"]),
    (P + "PLACE C: END_PLACE " + T + "TRANSITION w FROM (A, B) TO C := y; END_TRANSITION",
     ["4:7: P0112", "5:12: P0113"]),
    (P + T + "TRANSITION w FROM A TO B := y; END_TRANSITION", ["5:12: P0114"]),
    (P + T + "TRANSITION w FROM A TO B := NOT y; END_TRANSITION", []),
    (P + T + "TRANSITION w FROM A TO B := i > 5; END_TRANSITION", ["5:12: P0114"]),
    (P + T[:46], ["4:12: P0115"]), (P, ["3:15: P0115", "3:42: P0112"]),
    (P.replace("x := 1;", "") + T, ["3:42: P0116"]),
    (P + "INITIAL_PLACE C: x := 1; END_PLACE\n" + T, ["4:18: P0117"]),
    (P + T.replace("NOT y", "NOT y AND eoc OR A OR x"), ["4:85: P0118", "4:92: P0118"]),
    (P.replace("x := 1", "z := 1; i := 0"), ["3:45: P0020", "3:53: P0023"]),
    (P.replace("x := 1", "x := 2; x := i") + T, ["3:50: P0010"]),
    (P.replace("x := 1", "x := 1; x := 0") + T, ["3:53: P0021"]),
    (P + T + "PLACE a: END_PLACE PLACE i: END_PLACE\nTRANSITION e FROM A TO B := y; "
     "END_TRANSITION", ["5:7: P0021", "5:26: P0021", "6:12: P0021"]),
    (P + T.replace(":= y", ":= i") + "PLACE eoc: END_PLACE", ["4:29: P0023", "5:7: P0021"]),
    (P.replace(": x := 0; END_PLACE", " x := 0; END_PLACE") + T.replace("FROM A", "A", 1),
     ["3:17: P0010", "4:14: P0010"]),
    (P.replace("END_PLACE PLACE", "PLACE") + T.replace("y;", "y", 1),
     ["3:32: P0010", "4:31: P0010"]),
    (P.replace("END_PLACE", "ENDPLACE") + T, ["3:26: P0010", "3:52: P0010"]),
    (P + T.replace(" END_TRANSITION", "", 1), ["4:32: P0011"]),
]


@pytest.mark.parametrize(("text", "expected"), ST_CASES + IL_CASES + SFC_CASES + SIPN_CASES)
def test_a_mistake_in_a_body_gives_exactly_its_diagnostics(text, expected):
    unused = {"P0070"}
    assert [f for f in findings(body(IL, text)) if f[-5:] not in unused] == expected


@pytest.mark.parametrize(("text", "expected"), [
    ("", ["1:1: P0061"]), ("(* nothing *)\n// nothing", ["1:1: P0061"]),
    ("FUNCTION_BLOCK f END_FUNCTION_BLOCK", ["1:1: P0061"]), ("hello", ["1:1: P0010"]),
    ("hello world " + body("x : BOOL;", "x := x;"), ["1:1: P0010"]),
    ("PROGRAM m VAR x : BOOL; END_VAR x := x; ENDPROGRAM\n" + body("x : BOOL;", "x := z;"),
     ["1:41: P0010"]),
    ("PROGRAM m VAR x : BOOL; END_VAR LD x\nST x\nENDPROGRAM\n" + body("x : BOOL;", "x := z;"),
     ["3:1: P0010"]),
    (body("x : BOOL;", "x := x;") + "hello", ["5:1: P0010"]), ("\ufeffhello", ["1:1: P0010"]),
    ("PROGRAM\nVAR x : BOOL; END_VAR END_PROGRAM", ["2:1: P0010"]),
    ("PROGRAM m VAR x : BOOL; END_VAR\nx := x;", ["2:8: P0011"]),
    ("PROGRAM m VAR x : BOOL;\nx := x; END_PROGRAM", ["2:3: P0010"]),
    ("PROGRAM m VAR x : BOOL;\nLD x\nST x\nEND_PROGRAM", ["2:4: P0010"]),
    ("PROGRAM m VAR x : BOOL;\nINITIAL_STEP A: END_STEP END_PROGRAM", ["2:1: P0011"]),
    (body("x : BOOL\ny : BOOL;", "x := y;"), ["3:1: P0010"]),
    (body("x : BOOL; X : INT;", "x := 5;"), ["2:11: P0021"]),
    (body("x : BOOL;", "x := x;") * 2, ["5:9: P0021"]),
    ("FUNCTION_BLOCK TON VAR x : BOOL; END_VAR x := x; END_FUNCTION_BLOCK " + body("", ""),
     ["1:16: P0021"]),
    (body("x : BOOOL; y : INT;", "x := 5; y := 5; x(); x.y := 1;"), ["2:5: P0022"]),
    (body("x : INT := TRUE; t : TON := 5;", "x := 1; t();"), ["2:12: P0023", "2:29: P0023"]),
    (body("x : SINT := 200; u : USINT := -1;", "x := 128; u := 256;"),
     ["2:13: P0025", "2:31: P0025", "3:6: P0025", "3:16: P0025"]),
    (body("x : INT := y; y : INT := 1 + 2;", "x := y;"), ["2:12: P0027"]),
    (body("x AT %IX9999.0 : BOOL; y AT %QX0.9 : BOOL; z AT %Q5 : BOOL; w AT %ZZ : BOOL;",
          "x := y; z := w;"),
     ["2:6: P0030", "2:29: P0030", "2:49: P0030", "2:66: P0030"]),
    (body("x, y AT %IX0.0 : BOOL;", "x := y;"), ["2:9: P0030"]),
    (body("x AT %IW0 : BOOL; y AT %QX0.0 : INT; t AT %ML0 : TON;", "x := TRUE; t(); y := 1;"),
     ["2:6: P0031", "2:24: P0031", "2:43: P0031"]),
    ("FUNCTION_BLOCK f VAR x AT %IX0.0 : BOOL; END_VAR x := x; END_FUNCTION_BLOCK "
     + body("g : f;", "g();"),
     ["1:27: P0030"]),
    ("PROGRAM m VAR CONSTANT c : INT := 5; b : BOOL; END_VAR\nc := 6; END_PROGRAM", ["2:1: P0024"]),
    ("PROGRAM m VAR CONSTANT b : BOOL; END_VAR INITIAL_STEP A:\nb(N); END_STEP END_PROGRAM",
     ["2:1: P0024"]),
    ("FUNCTION_BLOCK f VAR g : f; END_VAR END_FUNCTION_BLOCK " + body("x : f;", "x();"),
     ["1:16: P0060"]),
    ("FUNCTION_BLOCK f VAR g : h; END_VAR END_FUNCTION_BLOCK\nFUNCTION_BLOCK h VAR g : f; END_VAR "
     "END_FUNCTION_BLOCK " + body("x : f;", "x();"), ["1:16: P0060"]),
    (body("x, y : BOOL;", "x := TRUE;"), ["2:4: P0070"]),
    ("CONFIGURATION c\nTASK t(INTERVAL := T#1s); PROGRAM p : MAIN; END_CONFIGURATION "
     + body("x : BOOL;", "x := TRUE;"), ["2:6: P0058"]),
    ("FUNCTION f : INT f := 5; END_FUNCTION\nTYPE t : (a, b); END_TYPE\n"
     "VAR_GLOBAL x : INT; END_VAR\n"
     + body("a : ARRAY[0..1] OF INT; s : STRING; x : BOOL;", "x := z;"),
     ["6:6: P0020"]),
    ("PROGRAM m VAR_TEMP t : TON; END_VAR VAR_INPUT u : TON; END_VAR t(); u(); END_PROGRAM",
     ["1:20: P0090", "1:47: P0090"]),
    ("PROGRAM m VAR_IN_OUT t : INT; END_VAR VAR_EXTERNAL u : INT; END_VAR END_PROGRAM",
     ["1:22: P0090", "1:52: P0020"]),
    ("FUNCTION f : INT\nf := g(); END_FUNCTION\nFUNCTION g : INT g := f() + g(); END_FUNCTION "
     + body("i : INT;", "i := f();"), ["1:10: P0060", "3:10: P0060"]),
    ("FUNCTION f : INT VAR_INPUT i : INT; END_VAR\nEND_FUNCTION "
     + body("i : INT;", "i := f(i);"), ["1:10: P0073"]),
    ("FUNCTION_BLOCK f VAR_OUTPUT a, b : INT; END_VAR\na := 5; END_FUNCTION_BLOCK "
     + body("g : f; i : INT;", "g(a => i); i := g.b;"), ["1:32: P0071"]),
    (body("x AT %QX0.0 : BOOL; y AT %QX0.1 : BOOL; z : BOOL;", "%QX0.1 := z; z := x;"),
     ["2:1: P0071"]),
    (body("t, u : TON; a : ARRAY[0..1] OF TON; x : BOOL;", "x := t.Q; u(); a[1]();"),
     ["2:1: P0072"]),
    ("FUNCTION f : INNT f := 5; END_FUNCTION\n" + body("x : INT;", "x := f();"), ["1:14: P0022"]),
    ("PROGRAM int\nEND_PROGRAM", ["1:9: P0021"]),
    (("PROGRAM m VAR x, y : BOOL; END_VAR VAR_TEMP\nz, w : INT; END_VAR\n"
     "w := 5; x := y AND w > 3; END_PROGRAM"), ["2:1: P0070"]),
    (("CONFIGURATION c VAR_GLOBAL\ng, h : INT; END_VAR RESOURCE r ON PLC\n"
     "TASK a (INTERVAL := T#10ms, PRIORITY := 1); TASK b (INTERVAL := T#20ms, PRIORITY := 2);\n"
     "PROGRAM p WITH a : m; PROGRAM q WITH b : n; END_RESOURCE END_CONFIGURATION\n"
     "PROGRAM m VAR_EXTERNAL g, h : INT; END_VAR g := h; END_PROGRAM\n"
     "PROGRAM n VAR_EXTERNAL g, h : INT; END_VAR g := g + h; h := 1; END_PROGRAM\n"),
     ["2:1: P0074"]),
    (" " * (SOURCE_LIMIT + 1), ["1:1: P0100"]),
])
def test_a_mistake_in_declarations_gives_exactly_its_diagnostics(text, expected):
    assert findings(text) == expected


def test_function_blocks_nested_too_deeply_are_diagnosed_at_the_innermost():
    blocks = "".join(f"FUNCTION_BLOCK f{n} VAR f : f{n + 1}; END_VAR END_FUNCTION_BLOCK\n"
                     for n in range(300))
    text = body("f : f0;", "f();") + blocks + "FUNCTION_BLOCK f300 END_FUNCTION_BLOCK"
    assert {f[-5:] for f in findings(text)} == {"P0014"}


def test_an_instance_that_doubles_with_every_level_reaches_the_limit_of_memory():
    blocks = "".join(f"FUNCTION_BLOCK f{n} VAR a, b : f{n + 1}; END_VAR END_FUNCTION_BLOCK\n"
                     for n in range(25))
    blocks += "FUNCTION_BLOCK f25 VAR_INPUT i : INT; END_VAR END_FUNCTION_BLOCK"
    text = body("f : f0;", "f();") + blocks
    assert {f[-5:] for f in findings(text)} == {"P0100"}


def test_a_file_that_cannot_be_read_is_diagnosed():
    with pytest.raises(CompileError) as caught:
        compile_program(Path("no/such/file.st"))
    assert str(caught.value).startswith("no/such/file.st:1:1: P0080 cannot read the file: No such")


def test_bytes_that_are_no_utf_8_are_found_at_their_place(tmp_path):
    path = tmp_path / "latin.st"
    path.write_bytes(b"PROGRAM m\n(* gr\xf6sse *)\nEND_PROGRAM")
    with pytest.raises(CompileError) as caught:
        compile_program(path)
    assert str(caught.value).startswith(f"{path}:2:6: P0080")


def test_every_code_of_the_table_is_shown_here():
    shown = {f[-5:] for _, expected in ST_CASES + IL_CASES + SFC_CASES for f in expected}
    text = Path(__file__).read_text("utf-8")
    assert [code for code in CODES if code not in shown and code not in text] == []


def test_every_error_is_found_however_many_warnings_come_first():
    steps = "".join(f"STEP s{n}: END_STEP\n" for n in range(DIAGNOSTIC_LIMIT + 50))
    bad = "PROGRAM two VAR x : BOOL; END_VAR x := z; END_PROGRAM"
    found = findings(body("x : BOOL;", A + steps) + bad)
    assert [f[-5:] for f in found if "P0055" not in f] == ["P0020"]


def test_no_more_errors_than_the_limit_are_kept():
    assert len(findings(body("x : BOOL;",
                             "x := z;\n" * (DIAGNOSTIC_LIMIT + 50)))) == DIAGNOSTIC_LIMIT


def test_mistakes_of_several_files_are_sorted_by_file_and_place(tmp_path):
    one, two = tmp_path / "1.st", tmp_path / "2.st"
    one.write_text(body("x : BOOL;", "x := z;"))
    two.write_text(body("x : BOOL;", "x := 5;").replace("MAIN", "OTHER"))
    with pytest.raises(CompileError) as caught:
        compile_program([two, one])
    assert [str(d).rsplit("/", 1)[1].split(": ")[:2] for d in caught.value.diagnostics] == [
        ["1.st:3:6", "P0020 'z' is not declared"],
        ["2.st:3:6", "P0023 this literal is no value of type BOOL"]]


@pytest.mark.parametrize(("text", "hint"), [
    (body("start : BOOL;", "stert := TRUE;"), "did you mean 'start'?"),
    (body("start : BOOOL;", ""), "did you mean 'BOOL'?"),
    (body("x : BOOL;", "LD x\nANDD x"), "did you mean 'AND'?"),
    (body("t : TON;", "t(INN := TRUE);"), "did you mean 'IN'?"),
    (body("t : TON; x : BOOL;", "t(QQQ => x);"), "its outputs are Q, ET"),
    (body("x : BOOL;",
          "INITIAL_STEP wait: END_STEP\nTRANSITION FROM wiat TO wait := x; END_TRANSITION"),
     "did you mean 'wait'?"),
    (body("x : BOOL;", "INITIAL_STEP A: cont(N); END_STEP ACTION count: END_ACTION"),
     "did you mean 'count'?"),
    (body("i : INT; d : DINT;", "i := d;"), "this would lose information"),
    (body("t : TON; x : BOOL;", "x := t;"), "name one of its outputs"),
])
def test_a_likely_fix_is_offered(text, hint):
    with pytest.raises(CompileError) as caught:
        compile_program(text)
    assert caught.value.diagnostics[0].hint == hint


def test_a_program_without_mistakes_has_no_diagnostics():
    assert findings(main("x : BOOL;", "x := NOT x;")) == []
