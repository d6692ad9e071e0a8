"""Soundness of charts: which steps can be active together (IEC 61131-3, 2.6.5).

A chart is taken as a net without times and conditions: every transition whose steps are active may
fire, one at a time. Situations are sets of steps, explored breadth first from the initial one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from plcemu.lang import syntax as s

FIRING_LIMIT = 20_000
"""Firings that are explored of one chart; of what lies beyond nothing is said."""


@dataclass(slots=True)
class Findings:
    """What the exploration found.

    Attributes:
        unsafe: (transition's number, step's name) of the first firing that enters a step which
            is active already, or None.
        dead: numbers of transitions whose steps are all reached but never active together; only
            known of charts that were explored completely.
    """

    unsafe: tuple[int, str] | None = None
    dead: list[int] = field(default_factory=list)


class Net:
    """The net of a chart whose steps all exist."""

    def __init__(self, body: s.SfcBody) -> None:
        self.steps = [step.name for step in body.steps]
        number = {name.upper(): n for n, name in enumerate(self.steps)}
        self.initial = sum(1 << n for n, step in enumerate(body.steps) if step.initial)
        self._arcs = [(_bits(t.sources, number), _bits(t.targets, number))
                      for t in body.transitions]
        self._leaving: dict[int, list[int]] = {}
        for n, transition in enumerate(body.transitions):
            first = number[transition.sources[0].head.upper()]
            self._leaving.setdefault(first, []).append(n)

    def explore(self) -> Findings:
        """Return what is unsafe or can never fire."""
        found, ever = Findings(), self.initial
        fired: set[int] = set()
        seen, pending = {self.initial}, [self.initial]
        firings = 0
        for situation in pending:
            ever |= situation
            for n in self._enabled(situation):
                sources, targets = self._arcs[n]
                twice = targets & situation & ~sources
                if twice and found.unsafe is None:
                    found.unsafe = n, self.steps[next(_numbers(twice))]
                fired.add(n)
                firings += 1
                following = (situation & ~sources) | targets
                if following not in seen:
                    seen.add(following)
                    pending.append(following)
            if firings > FIRING_LIMIT:
                return found
        found.dead = [n for n, (sources, _) in enumerate(self._arcs)
                      if n not in fired and sources & ever == sources]
        return found

    def _enabled(self, situation: int) -> Iterator[int]:
        for step in _numbers(situation):
            for n in self._leaving.get(step, ()):
                if self._arcs[n][0] & situation == self._arcs[n][0]:
                    yield n


def _bits(names: tuple[s.Name, ...], number: dict[str, int]) -> int:
    bits = 0
    for name in names:
        bits |= 1 << number[name.head.upper()]
    return bits


def _numbers(bits: int) -> Iterator[int]:
    while bits:
        lowest = bits & -bits
        yield lowest.bit_length() - 1
        bits ^= lowest
