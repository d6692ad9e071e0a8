"""Sequential Function Chart to statements: no engine knows of steps, transitions or actions.

In a scan, first all transitions are evaluated on the steps active at its start, then all step
flags change together, then the actions of the new situation run in textual order (docs/timing.md).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from plcemu.base.errors import did_you_mean
from plcemu.base.spans import Span
from plcemu.lang import syntax as s
from plcemu.lang.emitter import Emitter
from plcemu.lang.lower_st import Statements
from plcemu.lang.nodes import all_of, any_of, boolean, named
from plcemu.lang.report import Report
from plcemu.lang.scope import Scope
from plcemu.lang.scopebuilder import CONTROLLED, was_active
from plcemu.lang.sfc_net import Net
from plcemu.lang.types import BOOL, TIME

FunctionMaker = Callable[[str, s.IlBody | s.StBody | s.Expr, str], str]
"""Makes a function of the POU: local name, body or condition, and result type in; full name out."""


@dataclass(slots=True)
class _ActionUse:
    """An action and the (step, association) pairs that command it."""

    name: str
    span: Span
    uses: list[tuple[s.Step, s.Association]] = field(default_factory=list)


class Chart:
    """Lowers one SFC body into the main function of its POU."""

    def __init__(self, emitter: Emitter, make: FunctionMaker) -> None:
        self._out = emitter
        self._make = make
        self._scope: Scope = emitter.scope
        self._report: Report = emitter.report
        self._bodies: dict[str, str] = {}
        self._names: list[str] = []

    def lower(self, body: s.SfcBody) -> None:
        """Append the code of the chart."""
        self._bodies = {a.name.upper(): self._make(a.name, a.body, "") for a in body.actions}
        self._names = [a.name for a in body.actions]
        conditions = self._conditions(body)
        if not self._is_sound(body):
            return
        self._check_indicators(body)
        self._declare_flags(body)
        # The initial situation is taken on the first scan; transitions count from the second.
        span = body.span
        first = tuple(_set(step.span, f"__on_{step.name}") for step in body.steps if step.initial)
        begin = s.If(span, ((s.Unary(span, "NOT", named(span, "__started")),
                             (_set(span, "__started"), *first)),), _evolve(body, conditions))
        clocks = tuple(_clock(step) for step in body.steps)
        actions = [made for use in self._uses(body) for made in self._action(use)]
        Statements(self._out, of_chart=True).lower((begin, *clocks, *actions))

    # ------------------------------------------------------------ conditions

    def _conditions(self, body: s.SfcBody) -> list[str]:
        """Return the function of each transition's condition; named ones are made once."""
        named: dict[str, str] = {}
        for each in body.conditions:
            if each.name.upper() in named:
                self._report.error("P0021", each.span, f"condition {each.name!r} stands twice")
            elif each.condition is not None:
                named[each.name.upper()] = self._make(each.name, each.condition, "bool")
        made, taken = [], set(named)
        for n, transition in enumerate(body.transitions):
            found = self._named_condition(transition, named)
            if found is None and transition.condition is not None:
                self._name_once(transition, taken)
                found = self._make(transition.name or f"transition_{n + 1}", transition.condition,
                                   "bool")
            made.append(found or "")
        return made

    def _named_condition(self, transition: s.Transition, named: dict[str, str]) -> str | None:
        """Return the function of a condition that stands elsewhere under a name, if it is meant."""
        condition = transition.condition
        if condition is None:
            if transition.name.upper() not in named:
                self._report.error("P0020", transition.span, f"transition {transition.name!r} has "
                                   "no condition, and none of this name is declared",
                                   did_you_mean(transition.name, list(named)).removeprefix("; "))
            return named.get(transition.name.upper())
        if not isinstance(condition, s.Name) or len(condition.parts) != 1 \
                or condition.head.upper() in self._scope.places:
            return None
        return named.get(condition.head.upper())

    def _name_once(self, transition: s.Transition, taken: set[str]) -> None:
        """Report a second transition of a name."""
        if transition.name and transition.name.upper() in taken:
            self._report.error("P0021", transition.span,
                               f"transition {transition.name!r} stands twice")
        taken.add(transition.name.upper())

    # ------------------------------------------------------------ soundness

    def _is_sound(self, body: s.SfcBody) -> bool:
        steps = {step.name.upper(): step for step in body.steps}
        sound = True
        if not any(step.initial for step in body.steps):
            self._report.error("P0051", body.span, "the chart has no INITIAL_STEP")
            sound = False
        for transition in body.transitions:
            for name in transition.sources + transition.targets:
                if name.head.upper() not in steps:
                    hint = did_you_mean(name.head, [x.name for x in body.steps])
                    self._report.error("P0050", name.span, f"there is no step {name.head!r}",
                                       hint.removeprefix("; "))
                    sound = False
        self._unique(body)
        if not self._report.has_errors and sound:
            self._reachable(body, steps)
            self._explore(body)
        return sound

    def _unique(self, body: s.SfcBody) -> None:
        seen: set[str] = set()
        for action in body.actions:
            if action.name.upper() in seen:
                self._report.error("P0021", action.span, f"action {action.name!r} stands twice")
            seen.add(action.name.upper())

    def _reachable(self, body: s.SfcBody, steps: dict[str, s.Step]) -> None:
        """Warn of steps that no way from an initial step leads to."""
        missing = [{n.head.upper() for n in t.sources} for t in body.transitions]
        leaving: dict[str, list[int]] = {}
        for n, sources in enumerate(missing):
            for key in sources:
                leaving.setdefault(key, []).append(n)
        reached = {key for key, step in steps.items() if step.initial}
        pending = list(reached)
        while pending:
            key = pending.pop()
            for n in leaving.get(key, ()):
                missing[n].discard(key)
                if not missing[n]:
                    new = {x.head.upper() for x in body.transitions[n].targets} - reached
                    reached |= new
                    pending += new
        for key, step in steps.items():
            if key not in reached:
                self._report.warning("P0055", step.span, f"nothing reaches step {step.name!r}")

    def _explore(self, body: s.SfcBody) -> None:
        """Warn of what the chart's net, without times and conditions, cannot do or should not."""
        found = Net(body).explore()
        if found.unsafe is not None:
            number, step = found.unsafe
            self._report.warning("P0056", body.transitions[number].span, "this transition may "
                                 f"activate step {step} while it is active", "it stays active once")
        for number in found.dead:
            sources = ", ".join(name.head for name in body.transitions[number].sources)
            self._report.warning("P0057", body.transitions[number].span, "this transition never "
                                 f"fires: steps {sources} are never active together")

    def _check_indicators(self, body: s.SfcBody) -> None:
        """See that indicators of action blocks are BOOL variables; the chart does not set them."""
        for step in body.steps:
            for each in step.associations:
                for indicator in each.indicators:
                    found = self._out.value_place(indicator)
                    if found is not None and found[1] != BOOL:
                        self._report.error("P0023", indicator.span, "an indicator is a BOOL "
                                           f"variable, this is {found[1].name}")

    def _declare_flags(self, body: s.SfcBody) -> None:
        for step in body.steps:
            self._out.declare_local(f"__on_{step.name}", BOOL)
            self._out.declare_local(f"__off_{step.name}", BOOL)

    # ------------------------------------------------------------ actions

    def _uses(self, body: s.SfcBody) -> list[_ActionUse]:
        """Return the actions in textual order, each with everything that commands it."""
        uses: dict[str, _ActionUse] = {}
        for step in body.steps:
            for association in step.associations:
                use = uses.setdefault(association.action.upper(),
                                      _ActionUse(association.action, association.span))
                use.uses.append((step, association))
        return list(uses.values())

    def _action(self, use: _ActionUse) -> list[s.Statement]:
        active = self._command(use)
        control = f"__control_{use.name.upper()}"
        statements: list[s.Statement] = []
        if control.upper() in self._scope.places:
            statements = self._control(use, control, active)
            active = named(use.span, control, "Q")
        body = self._bodies.get(use.name.upper())
        if body is not None:
            return [*statements, *self._run(use, body, active)]
        variable = use.uses[0][1].variable or named(use.span, use.name)
        if not self._is_boolean_variable(use, variable):
            return []
        return [*statements, s.Assign(use.span, variable, active)]

    def _run(self, use: _ActionUse, body: str, active: s.Expr) -> list[s.Statement]:
        """Return what runs an action's body: while active and, with the final scan, once more."""
        span, run = use.span, s.RunAction(use.span, body)
        if was_active(use.name) not in self._scope.places:
            return [s.If(span, ((active, (run,)),))]
        # The pulses P1 and P0 run it without a final scan of their own (figures 14 and 15).
        now, was = f"__now_{use.name.upper()}", named(span, was_active(use.name))
        self._out.declare_local(now, BOOL)
        pulses = any_of([_pulse(step, a) for step, a in use.uses
                       if a.qualifier in ("P1", "P0")], span)
        resets = any_of([named(span, step.name, "X") for step, a in use.uses
                       if a.qualifier == "R"], span)
        runs = any_of([named(span, now), was,
                     all_of([pulses, s.Unary(span, "NOT", resets)], span)], span)
        return [s.Assign(span, named(span, now), active), s.If(span, ((runs, (run,)),)),
                s.Assign(span, was, named(span, now))]

    def _is_boolean_variable(self, use: _ActionUse, variable: s.Name | s.Direct) -> bool:
        if isinstance(variable, s.Direct) or len(variable.parts) > 1:
            return self._is_boolean_part(variable)
        place = self._scope.places.get(use.name.upper())
        if place is not None and place.type == BOOL and not place.read_only:
            return True
        if place is not None and place.type == BOOL:
            self._report.error("P0024", use.span,
                               f"{use.name} cannot be written: {place.read_only}")
            return False
        known = [*(p.name for p in self._scope.places.values() if p.type == BOOL), *self._names]
        self._report.error("P0054", use.span, f"there is no action or BOOL variable {use.name!r}",
                           did_you_mean(use.name, known).removeprefix("; "))
        return False

    def _is_boolean_part(self, variable: s.Name | s.Direct) -> bool:
        found = self._out.value_place(variable)
        if found is not None and found[1] != BOOL:
            self._report.error("P0054", variable.span, f"an action is a BOOL variable, this is "
                               f"{found[1].name}")
        return found is not None and found[1] == BOOL

    def _command(self, use: _ActionUse) -> s.Expr:
        """Return when the action runs by the qualifiers that need no memory: N, P, P1 and P0."""
        with_final_scan = was_active(use.name) in self._scope.places
        apart = ("P1", "P0") if with_final_scan else ()
        terms = [_pulse(step, a) for step, a in use.uses
                 if a.qualifier not in CONTROLLED and a.qualifier not in apart]
        return any_of(terms, use.span)

    def _control(self, use: _ActionUse, control: str, active: s.Expr) -> list[s.Statement]:
        """Return the statements that work the action's control block (figure 14)."""
        statements: list[s.Statement] = []
        arguments = [s.Argument(use.span, "N", active)]
        for qualifier in sorted(CONTROLLED):
            chosen = [(step, a) for step, a in use.uses if a.qualifier == qualifier]
            for step, association in chosen:
                if association.time is not None:
                    self._duration(association, control, step, statements)
            flags: list[s.Expr] = [named(a.span, step.name, "X") for step, a in chosen]
            arguments.append(s.Argument(use.span, qualifier, any_of(flags, use.span)))
        statements.append(s.Invoke(use.span, named(use.span, control), tuple(arguments)))
        return statements

    def _duration(self, association: s.Association, control: str, step: s.Step,
                  statements: list[s.Statement]) -> None:
        """Set the duration for a timed qualifier while its step is active."""
        assert association.time is not None
        span = association.time.span
        set_time = s.Assign(span, named(span, control, f"T_{association.qualifier}"),
                            association.time)
        statements.append(s.If(span, ((named(span, step.name, "X"), (set_time,)),)))


def _evolve(body: s.SfcBody, conditions: list[str]) -> tuple[s.Statement, ...]:
    """Return what decides which steps are left and entered: each step by one transition at most.

    Transitions are tried by priority, then from left to right (table 41).
    """
    ranked = sorted(enumerate(body.transitions),
                    key=lambda item: (item[1].priority is None, item[1].priority or 0, item[0]))
    statements: list[s.Statement] = []
    for n, transition in ranked:
        span = transition.span
        sources = [name.head for name in transition.sources]
        enabled: list[s.Expr] = [named(span, source, "X") for source in sources]
        enabled += [s.Unary(span, "NOT", named(span, f"__off_{source}")) for source in sources]
        fire = [_set(span, f"__off_{source}") for source in sources]
        fire += [_set(span, f"__on_{target.head}") for target in transition.targets]
        fires = s.If(span, ((s.Evaluate(span, conditions[n]), tuple(fire)),))
        statements.append(s.If(span, ((all_of(enabled, span), (fires,)),)))
    return tuple(statements)


def _clock(step: s.Step) -> s.Statement:
    """Set a step's flag; its time starts when it is entered and stands still when it is left."""
    span = step.span

    def assign(target: tuple[str, ...], value: s.Expr) -> s.Statement:
        return s.Assign(span, named(span, *target), value)

    entered = (assign((step.name, "X"), boolean(span, True)),
               assign((step.name, "T"), s.Literal(span, "time", 0, "TIME")),
               assign((step.name, "__limit"), s.Literal(span, "time", TIME.high, "TIME")))
    left = (assign((step.name, "X"), s.Literal(span, "bool", False)),
            assign((step.name, "__limit"), named(span, step.name, "T")))
    return s.If(span, ((named(span, f"__on_{step.name}"), entered),
                       (named(span, f"__off_{step.name}"), left)))


def _pulse(step: s.Step, association: s.Association) -> s.Expr:
    span = association.span
    by_qualifier = {"N": (step.name, "X"), "P0": (f"__off_{step.name}",)}
    return named(span, *by_qualifier.get(association.qualifier, (f"__on_{step.name}",)))


def _set(span: Span, name: str) -> s.Statement:
    return s.Assign(span, named(span, name), boolean(span, True))
