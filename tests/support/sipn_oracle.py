"""The firing rules of Signal Interpreted Petri Nets, written from the paper and used as an oracle.

Klein, Frey, Lesage, Litz, section 2: markings are sets of places, transitions are tried one by one.
"""

from __future__ import annotations

from dataclasses import dataclass, field

Condition = str | tuple
"""A signal's name, ("NOT", c), or (operator, c, d) with AND, OR or XOR."""


def holds(condition: Condition, signals: dict[str, bool]) -> bool:
    """Evaluate a condition."""
    if isinstance(condition, str):
        return signals[condition]
    values = [holds(each, signals) for each in condition[1:]]
    return {"NOT": lambda: not values[0], "AND": lambda: all(values), "OR": lambda: any(values),
            "XOR": lambda: values[0] != values[-1]}[condition[0]]()


def condition_text(condition: Condition) -> str:
    """Return a condition as ST."""
    if isinstance(condition, str):
        return condition
    inner = [f"({condition_text(each)})" for each in condition[1:]]
    return f"NOT {inner[0]}" if condition[0] == "NOT" else f" {condition[0]} ".join(inner)


@dataclass(frozen=True)
class Transition:
    """A transition with its pre-places, post-places and firing condition."""

    name: str
    pre: frozenset[str]
    post: frozenset[str]
    condition: Condition


@dataclass(frozen=True)
class Net:
    """A net: places with the values they give to outputs, and transitions in textual order."""

    places: dict[str, dict[str, bool]]
    initial: frozenset[str]
    transitions: tuple[Transition, ...]
    inputs: tuple[str, ...] = ("a", "b", "c")

    @property
    def outputs(self) -> list[str]:
        return sorted({name for given in self.places.values() for name in given})

    def text(self) -> str:
        """Return the net as a program MAIN."""
        rows = [f"{name} : BOOL;" for name in self.inputs + tuple(self.outputs)]
        body = []
        for name, given in self.places.items():
            values = " ".join(f"{o} := {int(v)};" for o, v in given.items())
            keyword = "INITIAL_PLACE" if name in self.initial else "PLACE"
            body.append(f"{keyword} {name}: {values} END_PLACE")
        for t in self.transitions:
            body.append(f"TRANSITION {t.name} FROM ({', '.join(sorted(t.pre))}) TO "
                        f"({', '.join(sorted(t.post))}) := {condition_text(t.condition)}; "
                        "END_TRANSITION")
        return "\n".join(["PROGRAM MAIN", "VAR", *rows, "END_VAR", *body, "END_PROGRAM", ""])


@dataclass
class Run:
    """A net in execution; `rounds` bounds the firings of one scan."""

    net: Net
    rounds: int = 100
    marking: frozenset[str] = frozenset()
    signals: dict[str, bool] = field(default_factory=dict)
    seen: set[str] = field(default_factory=set)
    flags: dict[str, bool] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.marking = self.net.initial
        self.flags = {"eoc": True, "conflict": False, "undefined": False,
                      "contradictory": False}
        self.outputs = dict.fromkeys(self.net.outputs, False)

    def able(self) -> list[Transition]:
        """Rules 1 and 2: which transitions can fire."""
        return [t for t in self.net.transitions if t.pre <= self.marking
                and not (t.post & self.marking) - t.pre and holds(t.condition, self.signals)]

    def fire(self) -> None:
        """Rule 3; of transitions in conflict the first in the text fires."""
        chosen: list[Transition] = []
        for t in self.able():
            if not any(t.pre & other.pre or t.post & other.post for other in chosen):
                chosen.append(t)
        gone = frozenset().union(*(t.pre for t in chosen))
        come = frozenset().union(*(t.post for t in chosen))
        self.marking = (self.marking - gone) | come

    def is_conflict(self) -> bool:
        able = self.able()
        return any(t.pre & other.pre or t.post & other.post
                   for n, t in enumerate(able) for other in able[:n])

    def scan(self, inputs: dict[str, bool]) -> dict[str, bool]:
        """Rule 4: fire until the marking is stable, on inputs that stand still meanwhile."""
        if self.flags["eoc"]:
            self.signals = dict(inputs)
        self.seen, conflict, done = set(), False, 0
        while True:
            self.seen |= {t.name for t in self.able()}
            conflict = conflict or self.is_conflict()
            self.flags["eoc"] = not self.able()
            done += 1
            self.fire()
            if self.flags["eoc"] or done == self.rounds:
                break
        return self._told(conflict)

    def step(self, inputs: dict[str, bool]) -> dict[str, bool]:
        """One state of the state graph: inputs change in a stable marking, else the net fires."""
        if self.flags["eoc"]:
            self.signals = dict(inputs)
        else:
            self.fire()
        self.seen = {t.name for t in self.able()}
        self.flags["eoc"] = not self.able()
        return self._told(self.is_conflict())

    def _told(self, conflict: bool) -> dict[str, bool]:
        self.flags["conflict"] = conflict
        if self.flags["eoc"]:
            given = {o: {self.net.places[p][o] for p in self.marking if o in self.net.places[p]}
                     for o in self.outputs}
            self.outputs |= {o: v == {True} for o, v in given.items() if v}
            self.flags["undefined"] = any(not v for v in given.values())
            self.flags["contradictory"] = any(len(v) == 2 for v in given.values())
        return {**{p: p in self.marking for p in self.net.places},
                **{t.name: t.name in self.seen for t in self.net.transitions},
                **self.outputs, **self.flags}
