"""Time from a program text to a ready PLC, at growing sizes: IL, ST and many small POUs.

"Ready" is a `Plc` at its cold start, its engine built. The import of the package is not counted.
The last column is the time a line at this size divided by the time a line at the smallest one: near
1 means linear growth. Of several rounds the fastest counts, since other work only adds.

    python benchmarks/compile_speed.py [--rounds N]
"""

from __future__ import annotations

import argparse
import gc
import time
from collections.abc import Callable

import plcemu

IL_BODY = ("LD a", "AND b", "OR( c", "ANDN a", ")", "ST d", "LD i", "ADD 1", "MUL j", "ST i",
           "GT 100", "S b", "LD i", "MOD 7", "ST j", "EQ 3", "R b", "LDN d", "XOR a", "ST c")

ST_BODY = """\
total := total + samples[k];
IF total > limit AND NOT blocked THEN
  total := 0;
  count := count + 1;
ELSIF total < -limit THEN
  total := -limit;
END_IF;
CASE count MOD 4 OF
  0: factor := 1.0;
  1, 2: factor := factor * 0.5 + INT_TO_REAL(count);
ELSE
  factor := MAX(factor, 2.5);
END_CASE;
FOR k := 0 TO 9 DO
  samples[k] := samples[k] + k * 2;
END_FOR;
delay(IN := total > 10, PT := T#100ms);
blocked := delay.Q OR (count > 100) XOR pt.on;
pt.x := pt.x + 1.5; // a comment that says what this is for
"""

POU = """\
FUNCTION_BLOCK FB_{n}
VAR_INPUT
  enable : BOOL;
  setpoint, actual : REAL;
END_VAR
VAR_OUTPUT
  output : REAL;
  done : BOOL;
END_VAR
VAR
  last : REAL;
  cycles : DINT;
  watch : TON;
END_VAR
IF enable THEN
  output := F_{n}(setpoint - actual, last);
  last := output;
  cycles := cycles + 1;
END_IF;
watch(IN := ABS(output) < 0.5, PT := T#2s, Q => done);
END_FUNCTION_BLOCK

FUNCTION F_{n} : REAL
VAR_INPUT
  a, b : REAL;
END_VAR
VAR
  sum : REAL;
END_VAR
sum := a * 0.75 + b * 0.25;
F_{n} := LIMIT(-10.0, sum, 10.0);
END_FUNCTION
"""


def il_program(instructions: int) -> str:
    """Return a PROGRAM of so many IL instructions."""
    body = [IL_BODY[n % len(IL_BODY)] for n in range(instructions)]
    return "\n".join(["PROGRAM MAIN", "VAR a, b, c, d : BOOL; i, j : INT; END_VAR", *body,
                      "END_PROGRAM"])


def st_program(lines: int) -> str:
    """Return a PROGRAM with one long body."""
    parts = ["TYPE point : STRUCT x : REAL; on : BOOL; END_STRUCT; END_TYPE", "PROGRAM MAIN",
             "VAR total, limit : DINT; blocked : BOOL; count, k : INT; factor : REAL;",
             "samples : ARRAY [0..9] OF DINT; delay : TON; pt : point; END_VAR"]
    return "\n".join([*parts, ST_BODY * (lines // ST_BODY.count("\n")), "END_PROGRAM"])


def st_library(lines: int) -> str:
    """Return a library of function blocks and functions, with a PROGRAM that uses each."""
    count = max(1, lines // (POU.count("\n") + 2))
    instances = "\n".join(f"b{n} : FB_{n};" for n in range(count))
    calls = "\n".join(f"b{n}(enable := TRUE, setpoint := 5.0, actual := b{max(0, n - 1)}.output);"
                      for n in range(count))
    return "".join(POU.format(n=n) for n in range(count)) \
        + f"PROGRAM MAIN VAR\n{instances}\nEND_VAR\n{calls}\nEND_PROGRAM\n"


SHAPES: dict[str, tuple[Callable[[int], str], tuple[int, ...], dict[int, float]]] = {
    "IL instructions": (il_program, (500, 1_000, 2_000, 5_000, 10_000, 20_000),
                        {1_000: 0.1, 10_000: 1.0}),
    "ST lines, one body": (st_program, (500, 1_000, 5_000, 20_000), {20_000: 10.0}),
    "ST lines, library": (st_library, (500, 1_000, 5_000, 20_000), {20_000: 10.0}),
}
"""By name: the generator, the sizes, and the promised seconds at some of them."""


def seconds_to_ready(text: str, rounds: int) -> float:
    """Return the time of the fastest of some rounds."""
    times = []
    for _ in range(rounds):
        gc.collect()
        start = time.perf_counter()
        plcemu.Plc(text)
        times.append(time.perf_counter() - start)
    return min(times)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=3)
    rounds = parser.parse_args().rounds
    plcemu.Plc(il_program(20))  # imports, and the library's first parse
    for name, (make, sizes, promised) in SHAPES.items():
        print(f"\n{name:>20} {'seconds':>9} {'us/line':>9} {'promised':>9} {'growth':>7}")
        first = 0.0
        for size in sizes:
            text = make(size)
            taken = seconds_to_ready(text, rounds)
            per_line_us = taken / size * 1e6
            first = first or per_line_us
            limit = f"{promised[size]:g} s" if size in promised else ""
            print(f"{size:>20} {taken:>9.3f} {per_line_us:>9.1f} {limit:>9} "
                  f"{per_line_us / first:>7.2f}")


if __name__ == "__main__":
    main()
