"""A finite plant as tables for SPIN: what it was asked while the closed loop was explored.

The plant's states are numbered; 0 is before the start, from where it begins in any of its initial
states. For each state the tables say what the sensors read, the facts, what it becomes under which
outputs, and what may happen next. A question that was never asked has no answer in them; the model
ends in an error there, so SPIN finds out by itself whether the tables are complete.

What may happen is sorted by who does it, for SPIN's weak fairness is one of processes: each name
that can be pending is a process, which can do what ends it. What no name waits for is done by
process 0.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Iterable, Mapping, Sequence
from itertools import groupby
from typing import Any, NamedTuple

from plcemu.io.mapping import Point
from plcemu.verify.loop import IDLE, FinitePlant
from plcemu.verify.promela.code import NoPromela

NOWHERE, FREE = 0, 0
"""The state before the start; the process that does what no fairness demands."""

UNKNOWN = -1
"""Stands for a state that the tables do not have."""


class Rest:
    """What happens where a run stays for ever, as nothing can happen or nothing is owed."""

    def __str__(self) -> str:
        return "nothing happens any more"


REST = Rest()


class Begin(NamedTuple):
    """The start of a run in one of the plant's initial states."""

    plant: Hashable


class Move(NamedTuple):
    """What may happen: in which state, who does it, what it is and the state after it."""

    source: int
    who: int
    action: Any
    after: int


class RecordedPlant:
    """A finite plant that writes down what it becomes under which outputs."""

    def __init__(self, plant: Any) -> None:
        self._plant = plant
        self.follows: dict[tuple[Hashable, tuple[tuple[str, Any], ...]], Hashable] = {}

    def __getattr__(self, name: str) -> Any:
        return getattr(self._plant, name)

    def actuate(self, state: Any, values: Mapping[str, Any]) -> Hashable:
        """The state once the actuators have these values."""
        found: Hashable = self._plant.actuate(state, values)
        self.follows[state, tuple(values.items())] = found
        return found


class PlantTables:
    """The tables.

    Args:
        plant: that was explored.
        outputs: those that the program uses, in the order of `pack`.
        idles: whether doing nothing is an action of its own (`merge: none`); if not, a run may stay
            where nothing is owed.
        fair: whether fairness demands that what is pending be done.
        rests: the plant's states in which something may happen next; in all others the loop goes on
            by itself, and what might happen there is not told.

    Raises:
        NoPromela: fairness demands what can never be done.
    """

    def __init__(self, plant: RecordedPlant, outputs: Sequence[Point], idles: bool, fair: bool,
                 rests: Collection[Hashable]) -> None:
        self.plant: FinitePlant = plant
        self.words = packing(outputs)
        self.initial = list(dict.fromkeys(plant.initial()))
        states = [*self.initial, *(s for s, _ in plant.follows), *plant.follows.values(), *rests]
        self.states: list[Any] = [None, *dict.fromkeys(states)]
        self.number = {state: n for n, state in enumerate(self.states) if n}
        self._rests, self._fair = set(rests), fair
        self.names = sorted({name for state in self._rests for name in self._pending(state)})
        self.moves = [move for n in range(len(self.states)) for move in self._moves(n, idles)]
        packed = {values: self._packed(dict(values), outputs)
                  for values in {values for _, values in plant.follows}}
        self.follows = sorted({(self.number[s], packed[values], self.number[after])
                               for (s, values), after in plant.follows.items()})

    @property
    def mixed(self) -> bool:
        """Whether some state has moves that fairness demands beside others."""
        return any(len({m.who == FREE for m in group}) > 1
                   for _, group in groupby(self.moves, lambda m: m.source))

    def _moves(self, source: int, idles: bool) -> list[Move]:
        if source == NOWHERE:
            return [Move(source, FREE, Begin(s), self.number[s]) for s in self.initial]
        state, plant = self.states[source], self.plant
        if state not in self._rests:
            return [Move(source, FREE, REST, UNKNOWN)]
        pending = self._pending(state)
        stays = [] if pending and not idles else [IDLE if idles else REST]
        moves = [Move(source, FREE, action, source) for action in stays]
        owed = set(pending)
        for action in plant.actions(state):
            after = self.number.get(plant.after(state, action), UNKNOWN)
            doers = sorted(pending & set(plant.done(action)))
            owed -= set(doers)
            moves += [Move(source, who, action, after)
                      for who in ([self.names.index(d) + 1 for d in doers] or [FREE])]
        if owed:
            raise NoPromela(f"{', '.join(sorted(owed))} cannot be done in a state where it is "
                            "pending; SPIN's fairness cannot demand it")
        return sorted(moves, key=lambda m: m.who)

    def _pending(self, state: Any) -> set[str]:
        return set(self.plant.pending(state)) if self._fair else set()

    def ends(self, number: int) -> bool:
        """Whether nothing can happen in a state."""
        state = self.states[number]
        return state in self._rests and not self.plant.actions(state)

    def _packed(self, values: Mapping[str, Any], outputs: Sequence[Point]) -> tuple[int, ...]:
        words: dict[int, int] = {}
        for point, (word, shift) in zip(outputs, self.words, strict=True):
            words[word] = words.get(word, 0) | point.to_raw(values[point.name]) << shift
        return tuple(_signed(words[n]) for n in sorted(words)) or (0,)

    def text(self, title: str, readings: Sequence[Sequence[int]],
             facts: Sequence[Sequence[int]]) -> str:
        """Return the tables as C.

        Args:
            title: of what.
            readings: what the program's inputs read in each state, state 0 left out.
            facts: their values, likewise.
        """
        images, image_of = _numbered(readings)
        kinds, kind_of = _numbered(facts)
        first_follow = _firsts(len(self.states), (row[0] for row in self.follows))
        first_move = _firsts(len(self.states), (m.source for m in self.moves))
        rows = []
        for n, state in enumerate(self.states):
            known = (image_of[n - 1], kind_of[n - 1]) if n else (0, 0)
            comment = f"  /* {n}: {self._comment(state)} */" if n in self._commented() else ""
            rows.append(f"{{{known[0]},{known[1]},{first_follow[n]},{first_move[n]}}},{comment}")
        rows.append(f"{{0,0,{len(self.follows)},{len(self.moves)}}}")
        words = len(self.follows[0][1]) if self.follows else 1
        return _HEADER.format(
            title=title, count=len(self.states), moves=len(self.moves),
            states="\n".join(rows), width=len(images[0]) or 1, images=_rows(images),
            kinds=_rows(kinds), facts=len(kinds[0]) or 1, words=words,
            follows=_rows([(*w, after) for _, w, after in self.follows]) or "{0}",
            parameters="".join(f", int word_{n}" for n in range(words)),
            equal=" && ".join(f"plant_follows[n][{n}] == word_{n}" for n in range(words)),
            move_rows=_rows([(m.who, m.after, int(m.action is REST and self.ends(m.source)))
                             for m in self.moves]))

    def _commented(self) -> range:
        return range(len(self.states)) if len(self.states) < 500 else range(1)

    def _comment(self, state: Any) -> str:
        text = "before the start" if state is None else repr(state)
        return text.replace("*/", "* /").replace("/*", "/ *").replace("\\", "/")[:200]


def packing(outputs: Sequence[Point]) -> list[tuple[int, int]]:
    """Return for each output the word of 32 bits that holds its raw value, and where in it."""
    places, word, used = [], 0, 0
    for point in outputs:
        bits = 1 if point.is_bit else 8 * point.width
        if bits > 32:
            raise NoPromela(f"{point.name} at {point.address} has more than 32 bits")
        if used + bits > 32:
            word, used = word + 1, 0
        places.append((word, used))
        used += bits
    return places


def _signed(word: int) -> int:
    return word - (1 << 32) if word >> 31 else word


def _numbered(rows: Sequence[Sequence[int]]) -> tuple[list[tuple[int, ...]], list[int]]:
    """Return the different rows, and the number of each."""
    found: dict[tuple[int, ...], int] = {}
    numbers = [found.setdefault(tuple(row), len(found)) for row in rows]
    return list(found), numbers


def _firsts(count: int, sources: Iterable[int]) -> list[int]:
    """Return for each state where its rows begin, the rows being sorted."""
    first, rows = [], list(sources)
    at = 0
    for n in range(count):
        while at < len(rows) and rows[at] < n:
            at += 1
        first.append(at)
    return first


def _rows(rows: Sequence[Sequence[int]]) -> str:
    return "\n".join("{" + ",".join(map(str, row or (0,))) + "}," for row in rows)


_HEADER = """\
/* {title}
 *
 * The finite plant as tables, made by plcemu: {count} states, {moves} moves.
 */
#include <stdlib.h>
#include <string.h>

/* what the inputs read */
static const int plant_readings[][{width}] = {{
{images}
}};

/* what is true of the plant */
static const int plant_facts[][{facts}] = {{
{kinds}
}};

/* the outputs, packed into words, and the state that follows them; UNKNOWN elsewhere */
static const int plant_follows[][{words} + 1] = {{
{follows}
}};

/* what may happen: who does it, the state after it, whether it is that nothing can happen */
static const int plant_moves[][3] = {{
{move_rows}
}};

/* each state: its readings, its facts, its first row in plant_follows and in plant_moves */
static const int plant_states[][4] = {{
{states}
}};

static int plant_start = -1;       /* the initial state to begin in; -1: any */
static const char *plant_asked;    /* the numbers of what is asked, as ",1,2,"; 0: everything */

static void plant_prepare(void)
{{
    const char *start = getenv("PLCEMU_START");
    plant_start = start ? atoi(start) : -1;
    plant_asked = getenv("PLCEMU_ASKED");
}}

static int plant_is_asked(const char *number)
{{
    return !plant_asked || strstr(plant_asked, number) != 0;
}}

static int plant_first(int plant, int who)
{{
    int n = plant_states[plant][3];
    while (n < plant_states[plant + 1][3] && plant_moves[n][0] < who)
        n++;
    return n;
}}

static int plant_choices(int plant, int who)
{{
    int first = plant_first(plant, who), n = first;
    while (n < plant_states[plant + 1][3] && plant_moves[n][0] == who)
        n++;
    return plant == 0 && who == 0 && plant_start >= 0 ? 1 : n - first;
}}

static int plant_move(int plant, int who, int choice)
{{
    return plant == 0 && plant_start >= 0 ? plant_start : plant_first(plant, who) + choice;
}}

static int plant_rests(int plant)
{{
    return plant_moves[plant_states[plant][3]][2];
}}

static int plant_named(int plant)
{{
    return plant_moves[plant_states[plant + 1][3] - 1][0] > 0;
}}

static int plant_follow(int plant{parameters})
{{
    int n = plant_states[plant][2];
    for (; n < plant_states[plant + 1][2]; n++)
        if ({equal})
            return plant_follows[n][{words}];
    return -1;
}}
"""
