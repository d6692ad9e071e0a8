"""Signal Interpreted Petri Nets to statements: no engine knows of places or markings.

In a scan the conditions are evaluated once, on the inputs as they stand, if the marking is stable
(`eoc`); while it is not, the inputs of the last stable marking count. Then transitions fire, round
after round, until none can. In each round all transitions that can fire do so together; of two that
share a place, the first in the text. Outputs follow stable markings only (docs/sipn.md).
"""

from __future__ import annotations

from collections.abc import Callable

from plcemu.base.errors import did_you_mean
from plcemu.base.types import ELEMENTARY
from plcemu.lang import syntax as s
from plcemu.lang.emitter import Emitter
from plcemu.lang.lower_sfc import FunctionMaker
from plcemu.lang.lower_st import Statements
from plcemu.lang.nodes import (
    all_of,
    any_of,
    assign,
    boolean,
    named,
    names_in,
    negated,
    number,
)
from plcemu.lang.report import Report
from plcemu.lang.sipn import FLAGS
from plcemu.lang.sipn_net import Net, output_key, warn_of
from plcemu.lang.types import BOOL

FlagOf = Callable[[s.NetTransition], str]
"""Names the variable that tells something of a transition."""
ROUNDS = 100
"""Rounds of firing in one scan; a net that is not stable then goes on in the next scan."""


class SignalNet:
    """Lowers one net into the main function of its POU.

    Args:
        emitter: of the main function.
        make: makes the function of a transition's condition.
        single: whether a scan either takes the inputs or fires once, so that each scan is one
            state of the net's state graph; else it fires until the marking is stable.
    """

    def __init__(self, emitter: Emitter, make: FunctionMaker, single: bool) -> None:
        self._out, self._make, self._single = emitter, make, single
        self._report: Report = emitter.report

    def lower(self, body: s.SipnBody) -> None:
        """Append the code of the net."""
        conditions = [self._make(t.name, t.condition, "bool") for t in body.transitions]
        if not self._is_sound(body):
            return
        net = Net(body)
        warn_of(body, net, self._report)
        for transition in body.transitions:
            self._out.declare_local(can(transition), BOOL)
            self._out.declare_local(fires(transition), BOOL)
        self._out.declare_local("__round", ELEMENTARY["INT"])
        take = tuple(assign(t.span, holds(t), s.Evaluate(t.condition.span, made))
                     for t, made in zip(body.transitions, conditions, strict=True))
        scan = self._one_step(body, net, take) if self._single else self._rounds(body, net, take)
        Statements(self._out, of_chart=True).lower((*scan, self._outputs(body)))

    # ------------------------------------------------------------ soundness

    def _is_sound(self, body: s.SipnBody) -> bool:
        known = [place.name for place in body.places]
        places = {each.upper() for each in known}
        sound = True
        if not any(place.initial for place in body.places):
            first = body.places[0].span if body.places else body.span
            self._report.error("P0111", first, "the net has no initial place",
                               "INITIAL_PLACE is marked at a cold start")
            sound = False
        for each in (n for t in body.transitions for n in (*t.sources, *t.targets)):
            if each.head.upper() not in places:
                hint = did_you_mean(each.head, known).removeprefix("; ")
                self._report.error("P0110", each.span, f"there is no place {each.head!r}", hint)
                sound = False
        for transition in body.transitions:
            self._reads_signals_only(body, transition)
        for place in body.places:
            sound = self._outputs_fit(place) and sound
        return sound and not self._report.has_errors

    def _reads_signals_only(self, body: s.SipnBody, transition: s.NetTransition) -> None:
        own = {n.upper() for n in (*FLAGS, *(p.name for p in body.places),
                                   *(t.name for t in body.transitions))}
        for each in names_in(transition.condition):
            if each.head.upper() in own and self._is_single(each.head):
                self._report.error("P0118", each.span, f"a condition reads signals, {each.head} is "
                                   "of the net itself", "let an arc come from the place, or go "
                                   "from it and back")

    def _is_single(self, name: str) -> bool:
        """Whether a name is not declared twice, which is reported already."""
        place = self._out.scope.places.get(name.upper())
        return place is None or place.base != "unknown"

    def _outputs_fit(self, place: s.NetPlace) -> bool:
        statements, seen, fit = Statements(self._out), set[str](), True
        for output in place.outputs:
            found = statements.writable(output.target)
            fit = fit and found is not None
            if found is not None and found[1] != BOOL:
                self._report.error("P0023", output.span, "an output of a net is a BOOL variable, "
                                   f"this is {found[1].name}")
            if output_key(output.target) in seen:
                self._report.error("P0021", output.span, f"place {place.name!r} gives this output "
                                   "a value twice")
            seen.add(output_key(output.target))
        return fit

    # ------------------------------------------------------------ firing

    def _rounds(self, body: s.SipnBody, net: Net,
                take: tuple[s.Statement, ...]) -> tuple[s.Statement, ...]:
        """Return a scan that fires until the marking is stable."""
        span = body.span
        reset = [assign(t.span, t.name, boolean(t.span, False)) for t in body.transitions]
        ability = [assign(t.span, can(t), _can_fire(t)) for t in body.transitions]
        seen = [assign(t.span, t.name,
                       any_of([named(t.span, t.name), named(t.span, can(t))], t.span))
                for t in body.transitions]
        collide = assign(span, "conflict", any_of([named(span, "conflict"),
                                                   _lost(body, can)], span))
        count = s.Assign(span, named(span, "__round"),
                         s.Binary(span, "ADD", named(span, "__round"), number(span, 1)))
        ended = any_of([named(span, "eoc"), s.Binary(span, "GE", named(span, "__round"),
                                                    number(span, ROUNDS))], span)
        loop = s.Repeat(span, (*ability, *seen, *_choose(body, net, can), collide,
                               _stable(body, can), *_fire(body), count), ended)
        return (s.If(span, ((named(span, "eoc"), take),)), *reset,
                assign(span, "conflict", boolean(span, False)), loop)

    def _one_step(self, body: s.SipnBody, net: Net,
                  take: tuple[s.Statement, ...]) -> tuple[s.Statement, ...]:
        """Return a scan that takes the inputs in a stable marking, and else fires once."""
        span = body.span
        ability = [assign(t.span, t.name, _can_fire(t)) for t in body.transitions]
        begin = s.If(span, ((named(span, "eoc"), take),),
                     (*_choose(body, net, _flag), *_fire(body)))
        return (begin, *ability, *_choose(body, net, _flag),
                assign(span, "conflict", _lost(body, _flag)), _stable(body, _flag))

    @staticmethod
    def _outputs(body: s.SipnBody) -> s.Statement:
        """Return what gives the outputs their values in a stable marking; 0 goes over 1."""
        span, given = body.span, given_by_places(body)
        sets, resets, statements = [], [], []
        for target, ones, zeros in given:
            marked = [any_of([named(span, p) for p in places], span) for places in (ones, zeros)]
            sets.append(marked[0])
            resets.append(marked[1])
            statements.append(s.If(target.span, (
                (marked[1], (s.Assign(target.span, target, boolean(span, False)),)),
                (marked[0], (s.Assign(target.span, target, boolean(span, True)),)))))
        none = [negated(any_of([a, b], span)) for a, b in zip(sets, resets, strict=True)]
        both = [all_of([a, b], span) for a, b in zip(sets, resets, strict=True)]
        told = (assign(span, "undefined", any_of(none, span)),
                assign(span, "contradictory", any_of(both, span)))
        return s.If(span, ((named(span, "eoc"), (*statements, *told)),))


def given_by_places(body: s.SipnBody) -> list[tuple[s.Name | s.Direct, list[str], list[str]]]:
    """Return each output with the places that give it 1, and those that give it 0."""
    found: dict[str, tuple[s.Name | s.Direct, list[str], list[str]]] = {}
    for place in body.places:
        for output in place.outputs:
            row = found.setdefault(output_key(output.target), (output.target, [], []))
            (row[1] if output.value else row[2]).append(place.name)
    return list(found.values())


def holds(transition: s.NetTransition) -> str:
    """Return the hidden variable with a transition's condition on the inputs last taken."""
    return f"__holds_{transition.name}"


def can(transition: s.NetTransition) -> str:
    """Return the local variable that tells whether a transition can fire in this round."""
    return f"__can_{transition.name}"


def fires(transition: s.NetTransition) -> str:
    """Return the local variable that tells whether a transition fires in this round."""
    return f"__fires_{transition.name}"


def _flag(transition: s.NetTransition) -> str:
    return transition.name


def _can_fire(transition: s.NetTransition) -> s.Expr:
    """Rules 1 and 2 of the firing process: enabled, and the condition fulfilled."""
    span, sources = transition.span, {each.head.upper() for each in transition.sources}
    terms: list[s.Expr] = [named(span, holds(transition))]
    terms += [named(span, each.head) for each in transition.sources]
    terms += [negated(named(span, each.head)) for each in transition.targets
              if each.head.upper() not in sources]
    return all_of(terms, span)


def _choose(body: s.SipnBody, net: Net, able: FlagOf) -> list[s.Statement]:
    """Rule 3: all that can fire do, but none that shares a place with one that fires already."""
    chosen: list[s.Statement] = []
    for n, transition in enumerate(body.transitions):
        span = transition.span
        rivals = [negated(named(span, fires(body.transitions[m]))) for m in net.rivals(n)]
        chosen.append(assign(span, fires(transition),
                             all_of([named(span, able(transition)), *rivals], span)))
    return chosen


def _lost(body: s.SipnBody, able: FlagOf) -> s.Expr:
    """Whether a transition that can fire does not, for another that shares a place."""
    return any_of([all_of([named(t.span, able(t)), negated(named(t.span, fires(t)))], t.span)
                   for t in body.transitions], body.span)


def _stable(body: s.SipnBody, able: FlagOf) -> s.Statement:
    none = negated(any_of([named(t.span, able(t)) for t in body.transitions], body.span))
    return assign(body.span, "eoc", none)


def _fire(body: s.SipnBody) -> list[s.Statement]:
    """Unmark the pre-places and mark the post-places of what fires."""
    fired: list[s.Statement] = []
    for transition in body.transitions:
        span = transition.span
        before = {each.head.upper() for each in transition.sources}
        after = {each.head.upper() for each in transition.targets}
        moves = [assign(span, each.head, boolean(span, False)) for each in transition.sources
                 if each.head.upper() not in after]
        moves += [assign(span, each.head, boolean(span, True)) for each in transition.targets
                  if each.head.upper() not in before]
        fired.append(s.If(span, ((named(span, fires(transition)), tuple(moves)),)))
    return fired
