"""The counterexamples of the heating tank's paper, one column a state.

Klein, Frey, Lesage, Litz (CESA 2003), Tables 3, 4 and 5, as printed, but for two misprints: in
Table 3 state 4 has P3 marked and P6 not, although T6 was fired and state 5 shows its effect; and
state 1 has eoc = 0 although no transition can fire. Rows without a 1 that the paper prints besides
are left out here; what is not named is 0 in every state.
"""

from __future__ import annotations

TABLE_3 = """
P1   1 1 0 0 0
P2   0 0 1 1 1
P3   0 0 1 0 0
P6   0 0 0 1 1
i4   0 1 1 1 0
i5   0 1 1 1 0
T1   0 1 0 0 0
T6   0 0 1 0 0
eoc  1 0 0 1 1
"""

TABLE_4 = """
P1   1 1 0
P2   0 0 1
P3   0 0 1
i4   0 1 1
i5   0 1 1
T1   0 1 0
T6   0 0 1
T10  0 0 1
eoc  1 0 0
"""

TABLE_5 = """
P1   1 1 0 0 0 0 0 0
P2   0 0 1 0 0 0 0 0
P3   0 0 1 0 0 0 0 0
P5   0 0 0 0 0 1 1 0
P6   0 0 0 1 1 0 0 1
P7   0 0 0 1 1 0 0 0
i4   0 1 1 1 1 1 0 0
i5   0 1 1 1 0 0 1 1
T1   0 1 0 0 0 0 0 0
T6   0 0 1 0 0 0 0 0
T8   0 0 0 0 0 0 1 0
T9   0 0 0 0 1 0 0 0
T10  0 0 1 0 0 0 0 0
eoc  1 0 0 1 0 1 0 1
"""


def states(table: str) -> list[dict[str, bool]]:
    """Return a table's columns: each state as names to values."""
    rows = [line.split() for line in table.split("\n") if line]
    return [{row[0]: row[n] == "1" for row in rows} for n in range(1, len(rows[0]))]
