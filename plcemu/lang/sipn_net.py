"""Soundness of Signal Interpreted Petri Nets: which markings they reach, and what is wrong there.

A net is explored without its conditions, one transition after the other. As transitions that fire
together share no place, this reaches every marking of a run, and perhaps some that conditions rule
out. Two conditions count as excluding each other if no value of the signals in them makes both
true; what is not AND, OR, XOR or NOT counts as a signal of its own.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import product

from plcemu.lang import syntax as s
from plcemu.lang.report import Report

FIRING_LIMIT = 20_000
"""Firings that are explored of one net; of what lies beyond nothing is said."""

SIGNAL_LIMIT = 12
"""Signals in conditions of which all values are tried; conditions with more may all be true."""


@dataclass(slots=True)
class Findings:
    """What the exploration found; transitions and places by their numbers in the text.

    Attributes:
        conflicts: (earlier, later) transitions to a marking in which both can fire.
        deadlock: the transition that leads (None: the initial marking) and the marking, or None.
        undefined: outputs' texts to a stable marking whose places give them no value.
        contradictory: outputs' texts to a stable marking whose places give them both values.
        unmarked: places that nothing marks; only known of nets that were explored completely.
        dead: transitions that never fire although their places are marked at times; likewise.
    """

    conflicts: dict[tuple[int, int], frozenset[int]] = field(default_factory=dict)
    deadlock: tuple[int | None, frozenset[int]] | None = None
    undefined: dict[str, frozenset[int]] = field(default_factory=dict)
    contradictory: dict[str, frozenset[int]] = field(default_factory=dict)
    unmarked: list[int] = field(default_factory=list)
    dead: list[int] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Arcs:
    """The places before and after a transition, by number."""

    sources: frozenset[int]
    targets: frozenset[int]

    def enabled(self, marking: frozenset[int]) -> bool:
        """Whether the pre-places are marked, and the post-places not (unless they are also pre)."""
        return self.sources <= marking and not (self.targets - self.sources) & marking

    def shares(self, other: Arcs) -> bool:
        """Whether firing both would mark or unmark one place in two ways."""
        return bool(self.sources & other.sources or self.targets & other.targets)


class Net:
    """A net whose places all exist."""

    def __init__(self, body: s.SipnBody) -> None:
        self._body = body
        number = {place.name.upper(): n for n, place in enumerate(body.places)}
        self.initial = frozenset(n for n, place in enumerate(body.places) if place.initial)
        self.arcs = [Arcs(frozenset(number[n.head.upper()] for n in t.sources),
                          frozenset(number[n.head.upper()] for n in t.targets))
                     for t in body.transitions]
        self._outputs = list(dict.fromkeys(output_key(o.target) for p in body.places
                                           for o in p.outputs))
        self._values = [{output_key(o.target): o.value for o in p.outputs} for p in body.places]
        self._both = cache(lambda a, b: self._possible((a, b), ()))
        self._stable = cache(lambda enabled: self._possible((), enabled))

    def rivals(self, n: int) -> list[int]:
        """Return the transitions before number `n` in the text with which it shares a place."""
        return [m for m in range(n) if self.arcs[m].shares(self.arcs[n])]

    def explore(self) -> Findings:
        """Return what the reachable markings show."""
        found, fired, ever = Findings(), set[int](), set(self.initial)
        before: dict[frozenset[int], int | None] = {self.initial: None}
        pending, firings = [self.initial], 0
        for marking in pending:
            enabled = tuple(n for n, arcs in enumerate(self.arcs) if arcs.enabled(marking))
            ever |= marking
            fired.update(enabled)
            self._look(found, marking, enabled, before[marking])
            for n in enabled:
                following = (marking - self.arcs[n].sources) | self.arcs[n].targets
                if following not in before:
                    before[following] = n
                    pending.append(following)
            firings += len(enabled)
            if firings > FIRING_LIMIT:
                return found
        found.unmarked = [n for n in range(len(self._body.places)) if n not in ever]
        found.dead = [n for n, arcs in enumerate(self.arcs)
                      if n not in fired and arcs.sources <= ever]
        return found

    def _look(self, found: Findings, marking: frozenset[int], enabled: tuple[int, ...],
              leading: int | None) -> None:
        if not enabled and found.deadlock is None:
            found.deadlock = leading, marking
        for at, later in enumerate(enabled):
            for earlier in enabled[:at]:
                if self.arcs[earlier].shares(self.arcs[later]) and self._both(earlier, later):
                    found.conflicts.setdefault((earlier, later), marking)
        if not marking or not self._stable(enabled):
            return
        for output in self._outputs:
            given = {self._values[n][output] for n in marking if output in self._values[n]}
            if not given:
                found.undefined.setdefault(output, marking)
            elif len(given) > 1:
                found.contradictory.setdefault(output, marking)

    def _possible(self, true: Sequence[int], false: Sequence[int]) -> bool:
        """Whether signals may make some transitions' conditions true and others' false."""
        conditions = [(self._body.transitions[n].condition, True) for n in true]
        conditions += [(self._body.transitions[n].condition, False) for n in false]
        names = sorted({each for c, _ in conditions for each in _signals(c)})
        if len(names) > SIGNAL_LIMIT:
            return True
        return any(all(_value(c, dict(zip(names, values, strict=True))) == wanted
                       for c, wanted in conditions)
                   for values in product((False, True), repeat=len(names)))


def warn_of(body: s.SipnBody, net: Net, report: Report) -> None:
    """Warn of what a net, whatever its signals do, cannot do or should not."""
    found = net.explore()

    def places(marking: frozenset[int]) -> str:
        return ", ".join(body.places[n].name for n in sorted(marking)) or "no place"

    def output(key: str) -> str:
        return next(written_as(o.target) for p in body.places for o in p.outputs
                    if output_key(o.target) == key)

    for (earlier, later), marking in found.conflicts.items():
        first, second = body.transitions[earlier], body.transitions[later]
        report.warning("P0114", second.span, f"{second.name} may be in conflict with {first.name} "
                       f"when marked are {places(marking)}", f"{first.name}, which stands first, "
                       "then fires alone")
    if found.deadlock is not None:
        leading, marking = found.deadlock
        span = body.places[min(marking, default=0)].span if leading is None \
            else body.transitions[leading].span
        report.warning("P0115", span, f"the net may stop for ever: no transition leads on when "
                       f"marked are {places(marking)}")
    for key, marking in found.undefined.items():
        report.warning("P0116", body.places[min(marking)].span, f"no place gives output "
                       f"{output(key)} a value when marked are {places(marking)}",
                       "it keeps the value it had")
    for key, marking in found.contradictory.items():
        given = [o for n in sorted(marking) for o in body.places[n].outputs
                 if output_key(o.target) == key]
        report.warning("P0117", given[-1].span, f"output {output(key)} is to be 0 and 1 when "
                       f"marked are {places(marking)}", "it is then 0")
    for n in found.unmarked:
        report.warning("P0112", body.places[n].span, f"nothing marks place {body.places[n].name!r}")
    for n in found.dead:
        report.warning("P0113", body.transitions[n].span, "this transition never fires: its places "
                       "are never marked, and those behind it free, together")


def output_key(target: s.Name | s.Direct) -> str:
    """Return an output's text in capitals, by which places name the same one."""
    return written_as(target).upper()


def written_as(expr: s.Expr) -> str:
    """Return an expression as written, without spaces."""
    return "".join(expr.span.source.text[expr.span.start:expr.span.end].split())


def _text(expr: s.Expr) -> str:
    return written_as(expr).upper()


_LOGIC = ("AND", "OR", "XOR")


def _signals(expr: s.Expr) -> Iterator[str]:
    if isinstance(expr, s.Binary) and expr.op in _LOGIC:
        yield from _signals(expr.left)
        yield from _signals(expr.right)
    elif isinstance(expr, s.Unary) and expr.op == "NOT":
        yield from _signals(expr.operand)
    elif not isinstance(expr, s.Literal):
        yield _text(expr)


def _value(expr: s.Expr, signals: Mapping[str, bool]) -> bool:
    if isinstance(expr, s.Binary) and expr.op in _LOGIC:
        left, right = _value(expr.left, signals), _value(expr.right, signals)
        return (left and right, left or right, left != right)[_LOGIC.index(expr.op)]
    if isinstance(expr, s.Unary) and expr.op == "NOT":
        return not _value(expr.operand, signals)
    return bool(expr.value) if isinstance(expr, s.Literal) else signals[_text(expr)]
