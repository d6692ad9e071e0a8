"""Writes a controller that follows a schedule: the program it is given, with other priorities.

Nothing is timed. Of each resource (a tank), the schedule says in which order processes use it; the
program remembers whose turn it is. A process starts when it is possible (Psi, as before) and its
turn on each of its resources. Since a schedule of the eager protocol starts every process as soon
as the one before it on some resource has ended, following the orders gives the schedule's times.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from plcemu.base.errors import PlcemuError

_PRIORITIES = re.compile(r"^ACTION Theta:.*?^END_ACTION\n", re.M | re.S)
_CHART = re.compile(r"^(?=INITIAL_STEP|STEP)", re.M)


class CannotEmit(PlcemuError):
    """The program has not the parts that a schedule is written into."""


@dataclass(frozen=True, slots=True)
class Order:
    """In which order processes use a resource: some once, then others again and again."""

    once: tuple[str, ...]
    again: tuple[str, ...]

    @property
    def turns(self) -> tuple[str, ...]:
        """The processes by turn."""
        return self.once + self.again


def orders(once: Sequence[str], again: Sequence[str],
           users: Mapping[str, Sequence[str]]) -> dict[str, Order]:
    """Return the order of each resource.

    Args:
        once: process starts, in order, before the schedule repeats itself.
        again: those that are repeated.
        users: for each process its resources.
    """
    resources = dict.fromkeys(name for names in users.values() for name in names)
    return {r: _shortest(Order(tuple(p for p in once if r in users[p]),
                               tuple(p for p in again if r in users[p]))) for r in resources}


def _shortest(order: Order) -> Order:
    """Return the same endless order with the fewest turns."""
    once, again = list(order.once), list(order.again)
    for n in range(1, len(again)):
        if len(again) % n == 0 and again == again[:n] * (len(again) // n):
            again = again[:n]
            break
    while once and again and once[-1] == again[-1]:
        again = [once.pop(), *again[:-1]]
    return Order(tuple(once), tuple(again))


def program_for(text: str, order: Mapping[str, Order], users: Mapping[str, Sequence[str]],
                title: str) -> str:
    """Return the program that follows the orders.

    Args:
        text: a program with an action `Theta`, conditions `Psi1` ... and steps `P1` ...
        order: of each resource.
        users: for each process its resources.
        title: what to say of the schedule in the first comment.

    Raises:
        CannotEmit: the text lacks one of these parts.
    """
    if not _PRIORITIES.search(text):
        raise CannotEmit("the program has no action Theta that a schedule could replace")
    chart = _CHART.search(text)
    if chart is None:
        raise CannotEmit("the program has no steps")
    text = _PRIORITIES.sub(lambda _: _theta(users) + _turning(order, users), text)
    text = text[:chart.start()] + _variables(order) + text[chart.start():]
    for process in users:
        text, count = re.subn(rf"^(STEP {process}:\n)", rf"\g<1>  {process}_turn(P1);\n", text,
                              flags=re.M)
        if count != 1:
            raise CannotEmit(f"the program has no step {process} of its own")
    return f"(* {title} *)\n\n{text}"


def _variables(order: Mapping[str, Order]) -> str:
    lines = ["(* Whose turn it is on each tank: numbers of processes, 0 is nobody's. The next turn",
             "   of the last one begins the part that is repeated. *)", "VAR"]
    for resource, rows in order.items():
        turns = [str(_number(p)) for p in rows.turns] + ([] if rows.again else ["0"])
        last = len(turns)
        back = len(rows.once) + 1 if rows.again else last
        following = [str(n) for n in range(2, last + 1)] + [str(back)]
        lines += [f"  {resource}_turn : INT := 1;",
                  f"  {resource}_user : ARRAY[1..{last}] OF INT := [{', '.join(turns)}];",
                  f"  {resource}_next : ARRAY[1..{last}] OF INT := [{', '.join(following)}];"]
    return "\n".join([*lines, "END_VAR", "", ""])


def _theta(users: Mapping[str, Sequence[str]]) -> str:
    lines = ["ACTION Theta:"]
    for process, resources in users.items():
        lines.append(f"  LD   Psi{_number(process)}")
        for resource in resources:
            lines += [f"  AND( {resource}_user[{resource}_turn]", f"  EQ   {_number(process)}",
                      "  )"]
        lines.append(f"  ST   Theta{_number(process)}")
    return "\n".join([*lines, "END_ACTION", "", ""])


def _turning(order: Mapping[str, Order], users: Mapping[str, Sequence[str]]) -> str:
    lines = ["(* A process that starts passes the turn on. *)", ""]
    for process, resources in users.items():
        lines.append(f"ACTION {process}_turn:")
        for resource in resources:
            lines += [f"  LD   {resource}_next[{resource}_turn]", f"  ST   {resource}_turn"]
        lines += ["END_ACTION", ""]
    return "\n".join(lines)


def _number(process: str) -> int:
    return int(process.lstrip("P"))
