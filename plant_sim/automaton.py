"""Hybrid automata: the short way to a plant of one's own (docs/plants.md shows one).

The state is a dictionary of quantities. A *mode* says how they go on (a law for each that changes
by itself), and which *guards* end it: a quantity, or a combination of quantities, passes a level in
a direction. A guard may *reset* quantities. After every event and every change of an actuator the
plant chooses its mode anew. Laws with a closed form are followed exactly; `Ode` is integrated.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, ClassVar, NamedTuple

from plant_sim.contract import Fact, FactValue, Port
from plant_sim.curves import (
    STILL,
    Approach,
    Curve,
    Law,
    Linear,
    LinearCurve,
    Number,
    Test,
    Torricelli,
)
from plant_sim.gauges import Sensor, actuator, disturbance, gauge, switch
from plant_sim.hybrid import End, HybridPlant, ZenoError
from plant_sim.lines import NEVER_NS, exact, first_not_negative
from plant_sim.parameters import Parameters
from plant_sim.solver import Ode, OdeCurve, State, Trajectory, search_first

__all__ = ["Alarm", "Approach", "Guard", "HybridAutomaton", "Linear", "Mode", "Ode", "Torricelli",
           "actuator", "disturbance", "falls", "gauge", "rises", "switch"]

Of = str | Mapping[str, Number] | Callable[[State], float]
Reset = Mapping[str, Any] | Callable[[State], Mapping[str, Any]]

RISING, FALLING = 1, -1
_CHOICES = 32
"""Choices of a mode at one instant; more means a model that never settles."""
SAMPLES = 256
"""Samples of a function guard where nothing is integrated; then the mode is entered anew."""


@dataclass(frozen=True)
class Guard:
    """Ends a mode where something passes a level in a direction.

    Attributes:
        name: of the event.
        of: a quantity, or a sum of quantities with factors, or any function of the state.
        level: that is passed.
        direction: RISING or FALLING. At the level counts as beyond it: a quantity that is at the
            level when the mode begins has not passed it.
        reset: quantities that get new values, or a function of the state that returns them.
        every_s: how close together a function is looked at, s.
    """

    name: str
    of: Of
    level: Number
    direction: int
    reset: Reset = field(default_factory=dict)
    every_s: float = 0.1

    def first_ns(self, lines: Mapping[str, Curve], t_ns: int) -> int:
        """The first instant after `t_ns` at which the level is passed, or NEVER_NS."""
        if isinstance(self.of, str):
            low, high = (-math.inf, self.level) if self.direction > 0 else (self.level, math.inf)
            return lines[self.of].first_ns(self._test(), low, high, t_ns)
        if not callable(self.of):
            moving = {n: f for n, f in self.of.items() if f}
            if all(_is_exact(lines[n]) for n in moving):
                return self._first_exact(lines, moving, t_ns)
        return search_first(_Combined(lines, self.of), self._test(),
                            _samples(lines.values(), t_ns, self.every_s), t_ns)

    def _test(self) -> Test:
        level = exact(self.level)
        return (lambda x: x >= level) if self.direction > 0 else (lambda x: x <= level)

    def _first_exact(self, lines: Mapping[str, Curve], of: Mapping[str, Number],
                     t_ns: int) -> int:
        """A sum of straight lines is one: its crossing is exact."""
        here = sum((exact(f) * lines[n].at(t_ns) for n, f in of.items()), Fraction(0))
        then = sum((exact(f) * lines[n].at(t_ns + 1) for n, f in of.items()), Fraction(0))
        value = (here - exact(self.level)) * self.direction
        slope = (then - here) * self.direction
        if value >= 0:
            return NEVER_NS
        den = math.lcm(value.denominator, slope.denominator)
        dt = first_not_negative(int(value * den), int(slope * den))
        return t_ns + dt if dt < NEVER_NS else NEVER_NS


def rises(name: str, of: Of, level: Number, reset: Reset | None = None) -> Guard:
    """A guard on the passing of a level from below."""
    return Guard(name, of, level, RISING, reset or {})


def falls(name: str, of: Of, level: Number, reset: Reset | None = None) -> Guard:
    """A guard on the passing of a level from above."""
    return Guard(name, of, level, FALLING, reset or {})


@dataclass(frozen=True)
class Alarm:
    """Ends a mode at an instant."""

    name: str
    t_ns: int
    reset: Reset = field(default_factory=dict)

    def first_ns(self, lines: Mapping[str, Curve], t_ns: int) -> int:
        """The instant, if it is still to come."""
        return self.t_ns if self.t_ns > t_ns else NEVER_NS


@dataclass(frozen=True)
class Mode:
    """How the plant goes on, until one of the guards is reached.

    Attributes:
        flows: the law of each quantity that changes by itself; the others stay as they are.
        guards: what ends the mode.
        now: quantities to set at once; then the mode is chosen anew.
    """

    flows: Mapping[str, Law] = field(default_factory=dict)
    guards: Iterable[Guard | Alarm] = ()
    now: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class NoParameters(Parameters):
    """A plant without parameters."""


class _Entry(NamedTuple):
    """The mode that the plant is in, with the instant and the state in which it was entered."""

    t_ns: int
    state: dict[str, Any]
    mode: Mode


class HybridAutomaton(HybridPlant):
    """Base of plants that are described by their modes.

    A plant supplies `elements`, `begin` and `mode`. In `mode` the state and `self.actuators` may
    be looked at, nothing else that changes: so a snapshot can be continued.
    """

    parameter_type: ClassVar[type[Parameters]] = NoParameters
    look_ahead_limit: ClassVar[int] = 32
    _entry: _Entry

    def __init__(self, parameters: Mapping[str, object] | Parameters | None = None) -> None:
        if not isinstance(parameters, Parameters):
            parameters = self.parameter_type.of(parameters or {})
        self.parameters = parameters
        elements = tuple(self.elements())
        sensors = [e for e in elements if isinstance(e, Sensor)]
        ports = [e.port if isinstance(e, Sensor) else e for e in elements
                 if not isinstance(e, Fact)]
        facts = [e for e in elements if isinstance(e, Fact)]
        super().__init__(parameters, ports, facts, {s.port.name: s.gauge for s in sensors})

    # What a plant supplies

    @abstractmethod
    def elements(self) -> Iterable[Port | Sensor | Fact]:
        """Sensors, actuators, disturbances and facts; `self.parameters` may be used."""

    @abstractmethod
    def begin(self) -> Mapping[str, Any]:
        """The quantities and their initial values; those of flows are numbers."""

    @abstractmethod
    def mode(self, x: dict[str, Any], on: Mapping[str, Any]) -> Mode:
        """The mode that the plant is in, given its state and its actuators and disturbances."""

    def _observe(self) -> dict[str, FactValue]:
        """Present values of all facts: the quantities of their names, which only events change."""
        return {fact.name: self._lines[fact.name].value for fact in self.facts}

    def report(self) -> dict[str, Any]:
        """Summary of the run so far: time, state and facts."""
        return {"t_s": self._t_ns / 1e9, "state": self.state(), "facts": self.observe()}

    def state(self) -> dict[str, Any]:
        """All quantities now; numbers that flow as floats."""
        return self._state(self._t_ns)

    # How quantities are kept

    def _begin(self) -> dict[str, Any]:
        return dict(self.begin())

    def _first_lines(self) -> dict[str, Any]:
        self._entry = _Entry(0, {}, Mode())
        return {name: STILL.curve(value, 0) for name, value in self._begin().items()}

    def _state(self, t_ns: int) -> dict[str, Any]:
        return {name: _seen(curve.at(t_ns)) for name, curve in self._lines.items()}

    def _settle(self, fired: frozenset[str]) -> None:
        for guard in self._entry.mode.guards:
            if guard.name in fired:
                self._assign(_news(guard.reset, self.state()))
        for _ in range(_CHOICES):
            mode = self.mode(self.state(), self.actuators)
            news = {n: v for n, v in mode.now.items() if self._lines[n].at(self._t_ns) != v}
            if not news:
                break
            self._assign(news)
        else:
            raise ZenoError(f"{self.name} never chooses a mode at {self._t_ns} ns")
        self._follow(mode)

    def _assign(self, values: Mapping[str, Any]) -> None:
        for name, value in values.items():
            if name not in self._lines:
                raise KeyError(f"{self.name} has no quantity {name}")
            law = self._entry.mode.flows.get(name, STILL)
            self._put(name, (STILL if isinstance(law, Ode) else law).curve(value, self._t_ns))

    def _follow(self, mode: Mode) -> None:
        """Let every quantity go on by its law of the mode; those whose law stays are left alone."""
        before, state = self._entry.mode.flows, self.state()
        for name in mode.flows:
            if name not in self._lines:
                raise KeyError(f"{self.name} has no quantity {name}")
        for name, curve in self._lines.items():
            law = mode.flows.get(name, STILL)
            if not isinstance(law, Ode) and law != before.get(name, STILL):
                self._put(name, law.curve(curve.at(self._t_ns), self._t_ns))
        self._enter(_Entry(self._t_ns, state, mode))

    def _enter(self, entry: _Entry) -> None:
        self._entry = entry._replace(mode=Mode(dict(entry.mode.flows), tuple(entry.mode.guards)))
        self._integrate({name: law.rate for name, law in entry.mode.flows.items()
                         if isinstance(law, Ode)})

    def _integrate(self, rates: Mapping[str, Callable[[State], float]]) -> None:
        if rates:
            t_ns = self._entry.t_ns
            others = {n: c for n, c in self._lines.items() if n not in rates}
            start = {n: float(self._lines[n].at(t_ns)) for n in rates}
            trajectory = Trajectory(rates, start, others, t_ns)
            for name in rates:
                self._put(name, OdeCurve(trajectory, name))

    def _put(self, quantity: str, line: Any) -> None:
        self._lines[quantity] = line
        self._moved.add(quantity)

    def _guards(self) -> Iterable[End]:
        return self._entry.mode.guards

    def _arm(self) -> None:
        super()._arm()
        horizon_ns = self._horizon_ns()
        if horizon_ns < self._mode_end_ns:
            self._mode_ends, self._mode_end_ns = [(horizon_ns, "horizon")], horizon_ns

    def _horizon_ns(self) -> int:
        """Where the quantities have been followed to, if that is before the end of the mode."""
        for curve in self._lines.values():
            if isinstance(curve, OdeCurve):
                return curve.trajectory.ends_before(self._mode_end_ns) or NEVER_NS
        spans = [round(guard.every_s * 1e9) * SAMPLES for guard in self._entry.mode.guards
                 if isinstance(guard, Guard) and _is_sampled(guard, self._lines)]
        return self._entry.t_ns + min(spans) if spans else NEVER_NS

    # Snapshots

    def _lines_image(self) -> Any:
        anchors = {n: [c.t0_ns, _plain(c.value)] for n, c in self._lines.items()}
        return {"entered_ns": self._entry.t_ns, "entered": self._entry.state, "anchors": anchors}

    def _restore_lines(self, image: Any) -> None:
        now_ns, state = self._t_ns, dict(image["entered"])
        self._t_ns = image["entered_ns"]
        mode = self.mode(dict(state), self.actuators)
        anchors = {n: (t0_ns, _rich(value)) for n, (t0_ns, value) in image["anchors"].items()}
        laws = {n: mode.flows.get(n, STILL) for n in anchors}
        self._lines = {n: (STILL if isinstance(laws[n], Ode) else laws[n]).curve(value, t0_ns)
                       for n, (t0_ns, value) in anchors.items()}
        self._enter(_Entry(self._t_ns, state, mode))
        self._t_ns = now_ns


# Combinations of quantities


class _Combined:
    """A sum or function of quantities as a curve."""

    def __init__(self, lines: Mapping[str, Curve], of: Of) -> None:
        self._lines, self._of = lines, of

    def at(self, t_ns: int) -> float:
        """The value at an instant."""
        if callable(self._of):
            return self._of({n: _seen(c.at(t_ns)) for n, c in self._lines.items()})
        assert not isinstance(self._of, str)
        return sum(float(f) * float(self._lines[n].at(t_ns)) for n, f in self._of.items())


def _samples(curves: Iterable[Curve], t_ns: int, every_s: float) -> Iterator[int]:
    for curve in curves:
        if isinstance(curve, OdeCurve):
            return curve.trajectory.samples(t_ns)
    step = round(every_s * 1e9)
    first = max((c.t0_ns for c in curves), default=0)
    begin = first + -(-(t_ns + 1 - first) // step) * step
    return iter(range(begin, begin + SAMPLES * step, step))


def _is_sampled(guard: Guard, lines: Mapping[str, Curve]) -> bool:
    if isinstance(guard.of, str):
        return False
    return callable(guard.of) or not all(_is_exact(lines[n]) for n in guard.of)


def _is_exact(curve: Curve) -> bool:
    return isinstance(curve, LinearCurve) or isinstance(curve.value, int | Fraction)


def _news(reset: Reset, state: dict[str, Any]) -> Mapping[str, Any]:
    return reset(state) if callable(reset) else reset


def _seen(value: Any) -> Any:
    return float(value) if isinstance(value, Fraction) else value


def _plain(value: Any) -> Any:
    return {"p/q": [value.numerator, value.denominator]} if isinstance(value, Fraction) else value


def _rich(value: Any) -> Any:
    return Fraction(*value["p/q"]) if isinstance(value, dict) else value
