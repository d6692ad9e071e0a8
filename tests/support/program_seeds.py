"""Program texts that use much of the language: seeds of random edits, programs for engines."""

from pathlib import Path

from controller import main

PROGRAMS = Path(__file__).parents[2] / "il_programs"
BATCH_PLANT = (PROGRAMS / "batch_plant/batch_plant.sfc").read_text("utf-8")

SEEDS = (
    BATCH_PLANT[:6000],
    "FUNCTION_BLOCK F VAR_INPUT a : BOOL; n : INT := 3; END_VAR VAR_OUTPUT q : BOOL; END_VAR\n"
    "VAR t : TON; k : INT; END_VAR t(IN := a, PT := T#50ms, Q => q);\nFOR k := 1 TO n DO\n"
    "IF k = 2 THEN EXIT; ELSIF a THEN RETURN; END_IF; END_FOR;\n"
    "CASE n OF 1: k := 2; 3..5: k := 7;\n"
    "ELSE k := -n; END_CASE; REPEAT k := k + 1; UNTIL k > 10 END_REPEAT; END_FUNCTION_BLOCK\n"
    + main("f : F; x AT %QX0.0 : BOOL; r : REAL; w : WORD;",
           "f(a := NOT x, n := 4); x := f.q; r := r * 0.5 + 1.0; w := w XOR 16#FF;"),
    main("a, b, x : BOOL; i : INT; t : TON;",
         "start: LD a\nANDN( b\nOR x\nXOR(\nLDN a\n)\n)\nST x\nSTN b\n"
         "LD i\nADD 1\nMUL( i\nSUB 3\n)\n"
         "ST i\nGT 100\nJMPCN start\nCAL t(\nIN := a,\nPT := T#1s,\nQ => b\n)\n"
         "LD x\nS a\nR b\nRETC\n"
         "CALC t(b)\nJMP the_end\nthe_end:"),
    ("PROGRAM P VAR x : BOOL; END_VAR INITIAL_STEP A: x(N); act(SD, T#5s); END_STEP\n"
     "STEP B: x(R); END_STEP TRANSITION t1 (PRIORITY := 1) FROM A TO (B, C) := A.T > T#1s;\n"
     "END_TRANSITION STEP C: END_STEP\nTRANSITION FROM (B, C) TO A : LD x ANDN B.X END_TRANSITION\n"
     "ACTION act: LD x\nSTN x\nEND_ACTION\nEND_PROGRAM"),
    "TYPE e : (one, two := 5, three) := two; s : STRUCT a : ARRAY [1..2] OF INT := [2(3)];\n"
    "k : e; END_STRUCT; r : INT (-5..5) := 1; END_TYPE\nVAR_GLOBAL CONSTANT n : INT := 3; END_VAR\n"
    "FUNCTION f : REAL VAR_INPUT x : REAL; p : s; END_VAR\n"
    "VAR_IN_OUT t : ARRAY [1..n] OF s; END_VAR\n"
    "VAR i : INT; END_VAR FOR i := n TO 1 BY -1 DO t[i].a[1] := t[i].a[2] * 2 - i;\n"
    "IF t[i].k = e#three THEN CONTINUE; END_IF; f := f + x ** 2.0; END_FOR; END_FUNCTION\n"
    + main("v : ARRAY [1..n] OF s := [(a := [1, 2], k := three)]; x : REAL; q : r; w : WORD;"
           "m : ARRAY [0..1, -1..1] OF BOOL;",
           "x := f(x := 1.5, p := v[1], t := v); m[0, q - 2] := SEL(x > 1.0, m[1, 1], NOT m[0, 0]);"
           "CASE v[2].k OF one: w := w AND NOT 16#F; two..three: w := SHL(w, 1) OR 1;"
           "ELSE q := LIMIT(-5, q + 1, MAX(q, 2, 3)); END_CASE; v[3] := v[q];"
           "WHILE q > n DO q := q - 1; END_WHILE;"),
    (main("n, k : INT; p, q : BOOL; c : CTU; d : CTD_LINT; t : TON := (PT := T#20ms);",
          "LD n\nABS\nMAX k, 3\nST n\nLIMIT(\nMN := 1,\nIN := (\nLD k\nADD 1\n),\nMX := 9\n)\n"
          "ST n\nagain: LD p\nCU c\nCD d\nIN t\nCAL c(p, FALSE, 2, q, k)\n"
          "ADD(EN := p, IN1 := n, IN2 := k, ENO => q)\ntwice 5\nGT 4\nJMPC again\nRETCN\n"
          "twice(n := n)\nST k")
     + "FUNCTION twice : INT VAR_INPUT n : INT; m : INT := 2; END_VAR LD n\nMUL m\nST twice\nRET\n"
     "END_FUNCTION"),
    main("a : STRING[9] := 'x$N$$'; b : WSTRING; d : DATE := D#2000-02-29; t : TOD;"
         "i : INT; o : BOOL;",
         "a := CONCAT(LEFT(a, 2), MID(a, 1, i), '$41'); i := LEN(a) + FIND(a, 'x');\n"
         "IF a <= 'b' AND d > D#1999-12-31 THEN t := TOD#12:30:00 + T#1s; END_IF;\n"
         "i := ADD(EN := o, IN1 := i, IN2 := STRING_TO_INT('5'), ENO => o); b := \"w$0041\";"),
)
