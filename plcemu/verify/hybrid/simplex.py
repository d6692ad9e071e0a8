"""Whether a system of linear inequalities, some of them strict, has a solution: exactly.

The simplex method on dictionaries with Bland's rule (Chvátal, Linear Programming, 1983, chapters 2
and 3), so that it never cycles, and in whole numbers over one common denominator, so that it never
rounds: each exchange divides without a rest (Edmonds, 1967; Bareiss, 1968).
"""

from __future__ import annotations

from collections.abc import Sequence

Inequality = tuple[Sequence[int], int, bool]
"""Factors and constant of `factors · x + constant <= 0`, and whether it is strict."""


def is_feasible(rows: Sequence[Inequality]) -> bool:
    """Whether some point satisfies all inequalities; the variables may have any sign.

    A strict inequality must hold by a margin, and it is asked whether the margin can be positive.
    """
    if not rows:
        return True
    size = len(rows[0][0])
    dictionary = _Dictionary(size + 2)
    for factors, constant, strict in rows:
        # x = p - q with p and q at least 0; one q serves all variables.
        dictionary.add(-constant, [*(-f for f in factors), sum(factors), -int(strict)])
    dictionary.add(1, [0] * (size + 1) + [-1])
    return dictionary.make_feasible() and dictionary.can_be_positive(size + 2)


class _Dictionary:
    """Basic variables as sums of nonbasic ones, all at least 0.

    Variables are numbered: 1 to `count` the first nonbasic ones, then the slacks of the rows; 0 is
    the auxiliary variable of the first phase. Of a row, the first number is its constant.
    """

    def __init__(self, count: int) -> None:
        self._names = list(range(1, count + 1))
        self._rows: list[list[int]] = []
        self._basics: list[int] = []
        self._below = 1
        """The common denominator of all rows, positive."""

    def add(self, constant: int, factors: Sequence[int]) -> None:
        """Add a slack, which must be at least 0."""
        self._rows.append([constant, *factors])
        self._basics.append(len(self._names) + len(self._rows))

    def make_feasible(self) -> bool:
        """Bring all constants to at least 0; whether that can be done."""
        worst = min(range(len(self._rows)), key=lambda n: self._rows[n][0])
        if self._rows[worst][0] >= 0:
            return True
        for row in self._rows:
            row.append(1)
        self._names.append(0)
        goal = [0] * len(self._names) + [-1]
        self._exchange(worst, len(self._names), goal)
        self._maximise(goal)
        if goal[0] < 0:
            return False
        if 0 in self._basics:
            place = self._basics.index(0)
            column = next((k for k, f in enumerate(self._rows[place]) if k and f), None)
            if column is None:
                del self._rows[place], self._basics[place]
                return True
            self._exchange(place, column, goal)
        column = self._names.index(0)
        del self._names[column]
        for row in self._rows:
            del row[column + 1]
        return True

    def can_be_positive(self, name: int) -> bool:
        """Whether a variable, bounded from above, takes values over 0."""
        if name in self._basics:
            goal = list(self._rows[self._basics.index(name)])
        else:
            goal = [0] * (len(self._names) + 1)
            goal[self._names.index(name) + 1] = self._below
        self._maximise(goal)
        return goal[0] > 0

    def _maximise(self, goal: list[int]) -> None:
        """Exchange variables until the goal, bounded from above, is largest."""
        while True:
            better = [k for k, factor in enumerate(goal) if k and factor > 0]
            if not better:
                return
            entering = min(better, key=lambda k: self._names[k - 1])
            self._exchange(self._binding(entering), entering, goal)

    def _binding(self, entering: int) -> int:
        """Return the row whose variable first falls to 0 as a nonbasic variable grows (Bland)."""
        best = -1
        for n, row in enumerate(self._rows):
            if row[entering] >= 0:
                continue
            if best >= 0:
                other = self._rows[best]
                earlier = other[0] * row[entering] - row[0] * other[entering]
                if earlier > 0 or (earlier == 0 and self._basics[best] < self._basics[n]):
                    continue
            best = n
        return best

    def _exchange(self, leaving: int, entering: int, goal: list[int]) -> None:
        """Let the basic variable of a row and the nonbasic one of a column change places."""
        pivot, below = self._rows[leaving], self._below
        factor = pivot[entering]
        sign = 1 if factor > 0 else -1
        for row in (*self._rows, goal):
            if row is not pivot:
                weight = row[entering]
                row[:] = [sign * (factor * value - weight * other) // below
                          for value, other in zip(row, pivot, strict=True)]
                row[entering] = sign * weight
        pivot[:] = [-sign * value for value in pivot]
        pivot[entering] = sign * below
        self._below = abs(factor)
        self._basics[leaving], self._names[entering - 1] = \
            self._names[entering - 1], self._basics[leaving]
