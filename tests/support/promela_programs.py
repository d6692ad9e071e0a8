"""Program texts within what Promela can say: whole numbers of 32 bits, BOOL, arrays, blocks."""

from __future__ import annotations

import random

IL = """PROGRAM MAIN
VAR a, b, c : BOOL; n : INT; w : WORD; edge : R_TRIG; END_VAR
  LD   a
  AND( b
  ORN  c
  )
  ST   c
  JMPC more
  LD   n
  SUB  3
  ST   n
  CAL  edge(CLK := b)
  LD   edge.Q
  S    a
more:
  LD   w
  XOR  16#0F0F
  ST   w
  LD   n
  LT   -20
  RETC
  LD   c
  R    b
END_PROGRAM
"""

BLOCKS = """FUNCTION Limited : INT
VAR_INPUT x, low, high : INT; END_VAR
  IF x < low THEN Limited := low; RETURN; END_IF;
  Limited := MIN(x, high);
END_FUNCTION
FUNCTION_BLOCK Ramp
VAR_INPUT goal : INT; END_VAR
VAR_OUTPUT value : INT; there : BOOL; END_VAR
  IF value < goal THEN value := value + 7; ELSIF value > goal THEN value := value - 5; END_IF;
  there := value = goal;
END_FUNCTION_BLOCK
PROGRAM MAIN
VAR one, two : Ramp; n : INT; count : CTU; x : BOOL; END_VAR
  one(goal := Limited(n, -50, 50));
  two(goal := one.value / 2);
  count(CU := two.there AND x, PV := 3);
  x := NOT x OR count.Q;
END_PROGRAM
"""

ARRAYS = """PROGRAM MAIN
VAR a : ARRAY [-1..4] OF INT; m : ARRAY [1..2, 0..2] OF BOOL; i, j : INT; d : DINT;
  s : ARRAY [0..1] OF STRUCT p : INT; q : BOOL; END_STRUCT; END_VAR
  FOR i := -1 TO 4 DO d := d + a[i] * i; END_FOR;
  a[j MOD 7] := a[2] + 1;
  m[1, ABS(i) MOD 3] := m[2, 1] XOR (d > 5);
  s[ABS(j) MOD 2].p := j;
  s[1].q := s[0].p > s[1].p;
  WHILE j > 3 DO j := j - 2; IF j = 7 THEN EXIT; END_IF; END_WHILE;
END_PROGRAM
"""

CHART = """PROGRAM MAIN
VAR go, stop, lamp, motor : BOOL; n : INT; END_VAR
INITIAL_STEP idle: END_STEP
STEP run: motor(N); count(P1); END_STEP
STEP halt: lamp(N); END_STEP
TRANSITION FROM idle TO run := go; END_TRANSITION
TRANSITION FROM run TO halt := stop AND n > 2; END_TRANSITION
TRANSITION FROM run TO idle := NOT go; END_TRANSITION
TRANSITION FROM halt TO idle := NOT stop; END_TRANSITION
ACTION count: n := n + 1; END_ACTION
END_PROGRAM
"""

TEXTS = {"IL": IL, "blocks": BLOCKS, "arrays": ARRAYS, "chart": CHART}

_NUMBERS = {"b": "SINT", "k": "INT", "d": "DINT", "ub": "USINT", "uk": "UINT", "ud": "UDINT"}
_BITS = {"y8": "BYTE", "w16": "WORD", "w32": "DWORD"}


class _Text:
    """Makes a body out of statements and typed expressions."""

    def __init__(self, seed: int) -> None:
        self.chance = random.Random(seed)

    def number(self, name: str, depth: int) -> str:
        """An expression of a number variable's type."""
        type_ = _NUMBERS[name]
        if depth == 0 or self.chance.random() < 0.2:
            other = self.chance.choice(list(_NUMBERS))
            return self.chance.choice((name, f"{_NUMBERS[other]}_TO_{type_}({other})"
                                       if other != name else name,
                                       f"{type_}#{self.chance.choice((0, 1, 2, 7, 100))}"))
        a, b = self.number(name, depth - 1), self.number(name, depth - 1)
        return self.chance.choice((
            f"({a} + {b})", f"({a} - {b})", f"({a} * {b})", f"({a} / {b})", f"({a} MOD {b})",
            f"SEL({self.truth(depth - 1)}, {a}, {b})", f"MAX({a}, {b})",
            *((f"ABS({a})",) if not name.startswith("u") else ())))

    def bits(self, name: str, depth: int) -> str:
        """An expression of a bit string variable's type."""
        if depth == 0:
            return self.chance.choice((name, f"{_BITS[name]}#16#5A"))
        a, b = self.bits(name, depth - 1), self.bits(name, depth - 1)
        count = self.chance.choice(("3", "k MOD 40", "ub"))
        return self.chance.choice((f"({a} AND {b})", f"({a} OR {b})", f"({a} XOR {b})",
                                   f"(NOT {a})", f"SHL({a}, {count})", f"SHR({a}, {count})",
                                   f"ROL({a}, {count})", f"ROR({a}, {count})"))

    def truth(self, depth: int) -> str:
        """A Boolean expression."""
        if depth == 0:
            return self.chance.choice(("p", "q", "TRUE"))
        name = self.chance.choice(list(_NUMBERS))
        compared = self.chance.choice(("<", "<=", "=", "<>", ">", ">="))
        return self.chance.choice((
            f"({self.number(name, depth - 1)} {compared} {self.number(name, depth - 1)})",
            f"({self.truth(depth - 1)} AND {self.truth(depth - 1)})",
            f"({self.truth(depth - 1)} OR NOT {self.truth(depth - 1)})",
            f"({self.truth(depth - 1)} XOR {self.truth(depth - 1)})"))

    def statement(self, depth: int) -> str:
        """A statement."""
        name, bits = self.chance.choice(list(_NUMBERS)), self.chance.choice(list(_BITS))
        simple = (f"{name} := {self.number(name, 2)};", f"{bits} := {self.bits(bits, 2)};",
                  f"{self.chance.choice('pq')} := {self.truth(2)};",
                  f"a[k MOD 4] := {self.number('k', 1)};", "k := a[ABS(b) MOD 3];")
        if depth == 0:
            return self.chance.choice(simple)
        inner, other = self.statement(depth - 1), self.statement(depth - 1)
        return self.chance.choice((
            *simple, f"IF {self.truth(1)} THEN {inner} ELSE {other} END_IF;",
            f"CASE k OF 0: {inner} 1..9: {other} ELSE p := FALSE; END_CASE;",
            f"FOR b := -2 TO 3 DO {inner.replace('b :=', 'ub :=')} END_FOR;",
            f"WHILE ub > 3 DO ub := ub / 2; {other} IF p THEN EXIT; END_IF; END_WHILE;"))


def random_text(seed: int) -> str:
    """Return a random program; equal seeds give equal ones. Not every one compiles."""
    text = _Text(seed)
    body = "\n".join(text.statement(2) for _ in range(6))
    declared = "".join(f"{n} : {t};" for n, t in {**_NUMBERS, **_BITS}.items())
    return (f"PROGRAM MAIN\nVAR p, q : BOOL; {declared} a : ARRAY [0..3] OF INT; END_VAR\n{body}\n"
            "END_PROGRAM\n")
