"""Laws, guards and trajectories against closed forms, brute force and scipy."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from fractions import Fraction
from typing import Any, ClassVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from plant_sim import Fact, image
from plant_sim.automaton import (
    Alarm,
    Approach,
    Guard,
    HybridAutomaton,
    Linear,
    Mode,
    Ode,
    Torricelli,
    actuator,
    falls,
    gauge,
    rises,
    switch,
)
from plant_sim.curves import Caught, Law
from plant_sim.lines import NEVER_NS

S = 1_000_000_000
LEVELS = st.floats(0.01, 10.0)


# single curves


def first_ns(law: Law, start: float, level: float) -> int:
    """When a curve from `start` at 0 is at or beyond a level, on the side it goes to."""
    curve = law.curve(start, 0)
    up = level > start
    low, high = (-math.inf, level) if up else (level, math.inf)
    return curve.first_ns((lambda x: x >= level) if up else (lambda x: x <= level), low, high, 0)


@given(start=LEVELS, part=st.floats(0.0, 0.99), k=st.floats(0.01, 10))
def test_torricelli_reaches_a_level_at_the_instant_of_its_formula(start: float, part: float,
                                                                  k: float) -> None:
    level = start * part
    exact_s = 2 * (math.sqrt(start) - math.sqrt(level)) / k
    assert first_ns(Torricelli(k), start, level) == pytest.approx(exact_s * S, abs=2, rel=1e-12)


@given(start=st.floats(-5, 5), target=st.floats(-5, 5), part=st.floats(0.01, 0.99),
       tau=st.floats(0.01, 1000))
def test_an_approach_reaches_a_level_at_the_instant_of_its_formula(start: float, target: float,
                                                                   part: float, tau: float) -> None:
    target = target if abs(target - start) > 0.01 else start + 1
    level = start + (target - start) * part
    exact_s = -tau * math.log1p(-(level - start) / (target - start))
    found = first_ns(Approach(target, tau), start, level)
    assert found == pytest.approx(exact_s * S, abs=2, rel=1e-9)


@given(start=st.fractions(-5, 5, max_denominator=1000),
       rate=st.fractions(-5, 5, max_denominator=1000),
       level=st.fractions(-5, 5, max_denominator=1000))
def test_a_line_reaches_a_level_at_the_first_whole_ns_exactly(start: Fraction, rate: Fraction,
                                                              level: Fraction) -> None:
    found = first_ns(Linear(rate), start, level)  # type: ignore[arg-type]
    way = (level - start) / rate * S if rate else Fraction(-1)
    assert found == (math.ceil(way) if way > 0 else NEVER_NS)


def test_what_is_caught_is_what_was_given() -> None:
    outflow = Torricelli(0.7)
    given_away, caught = outflow.curve(2.0, 0), Caught(0.5, outflow, 2.0).curve(1.0, 0)
    for t_ns in range(0, 5 * S, S // 7):
        assert caught.at(t_ns) == pytest.approx(1.0 + 0.5 * (2.0 - given_away.at(t_ns)))


@pytest.mark.parametrize(("law", "start", "level"), [
    (Torricelli(1.0), 1.0, 2.0), (Torricelli(1.0), 1.0, -0.1), (Approach(1.0, 2.0), 0.0, 1.0),
    (Approach(1.0, 2.0), 0.0, 1.5), (Approach(1.0, 2.0), 0.0, -0.5), (Linear(1), 0, -1),
    (Linear(0), 0, 1),
])
def test_a_level_that_is_never_reached_is_never_reached(law: Law, start: float,
                                                        level: float) -> None:
    assert first_ns(law, start, level) == NEVER_NS


# whole automata


class Toy(HybridAutomaton):
    """An automaton given by functions."""

    name: ClassVar[str] = "toy"

    def __init__(self, begin: Mapping[str, Any], mode: Any, *elements: Any) -> None:
        self._given = begin, mode, elements
        super().__init__()

    def elements(self) -> Iterable[Any]:
        return self._given[2]

    def begin(self) -> Mapping[str, Any]:
        return self._given[0]

    def mode(self, x: dict[str, Any], on: Mapping[str, Any]) -> Mode:
        found: Mode = self._given[1](x, on)
        return found


def pendulum(x: dict[str, Any], on: Mapping[str, Any]) -> Mode:
    flows = {"angle": Ode(lambda x: x["speed"]),
             "speed": Ode(lambda x: -9.81 * math.sin(x["angle"]))}
    return Mode(flows, (
        rises("right", "angle", 0.0, lambda x: {"swings": x["swings"] + 1}),
        falls("left", "angle", 0.0, lambda x: {"swings": x["swings"] + 1})))


def swinging() -> Toy:
    return Toy({"angle": 1.0, "speed": 0.0, "swings": 0}, pendulum, Fact("swings", "int", "", ""))


def crossings(plant: HybridAutomaton, until_ns: int) -> list[int]:
    found = []
    while (t_ns := plant.next_event_ns()) is not None and t_ns <= until_ns:
        plant.advance(t_ns)
        found.append(t_ns)
    return found


def test_the_events_of_an_ode_agree_with_scipy() -> None:
    def zero(_: float, y: Any) -> float:
        angle: float = y[0]
        return angle
    oracle = solve_ivp(lambda _, y: [y[1], -9.81 * math.sin(y[0])], (0, 5), [1.0, 0.0],
                       events=zero, rtol=1e-12, atol=1e-13, method="DOP853")
    plant = swinging()
    seen: list[int] = []
    while plant.observe()["swings"] < len(oracle.t_events[0]):
        before = plant.observe()["swings"]
        t_ns = plant.next_event_ns()
        assert t_ns is not None
        plant.advance(t_ns)
        seen += [t_ns] * (int(plant.observe()["swings"]) - int(before))
    assert np.array(seen) / S == pytest.approx(oracle.t_events[0], abs=1e-7)


@settings(max_examples=8, deadline=None)
@given(stops=st.lists(st.integers(0, 2 * S), max_size=20))
def test_how_time_is_cut_does_not_change_an_ode(stops: list[int]) -> None:
    whole, cut = swinging(), swinging()
    whole.advance(2 * S)
    for t_ns in sorted(stops):
        cut.advance(t_ns)
        cut.next_event_ns()
    cut.advance(2 * S)
    assert cut.snapshot() == whole.snapshot()


def bouncing(x: dict[str, Any], on: Mapping[str, Any]) -> Mode:
    return Mode({"v": Linear(-10), "h": Ode(lambda x: x["v"])},
                (falls("bounce", "h", 0.0,
                       lambda x: {"h": 0.0, "v": -0.5 * x["v"], "n": x["n"] + 1}),))


def test_a_ball_bounces_at_the_instants_of_the_formula() -> None:
    ball = Toy({"h": 5.0, "v": 0.0, "n": 0}, bouncing, Fact("n", "int", "", ""))
    instants = []
    for n in range(1, 5):
        while ball.observe()["n"] < n:
            t_ns = ball.next_event_ns()
            assert t_ns is not None
            ball.advance(t_ns)
        instants.append(ball.t_ns / S)
    # It falls for 1 s and then flies 2 * 1/2, 2 * 1/4, ... s.
    assert instants == pytest.approx([1.0, 2.0, 2.5, 2.75], abs=1e-7)


RATES = st.tuples(*[st.integers(-5, 5)] * 2)


@settings(max_examples=60, deadline=None)
@given(rates=st.lists(RATES, min_size=4, max_size=4), start=st.tuples(*[st.integers(-3, 3)] * 2),
       stops=st.lists(st.integers(0, 20 * S), max_size=10))
def test_random_piecewise_linear_plants_do_what_rational_arithmetic_says(
        rates: list[tuple[int, int]], start: tuple[int, int], stops: list[int]) -> None:
    """Four modes by the signs of two quantities; the rates change where a quantity passes 0."""
    def corner(a: bool, b: bool) -> tuple[int, int]:
        return rates[2 * a + b]

    def mode(x: dict[str, Any], on: Mapping[str, Any]) -> Mode:
        ra, rb = corner(x["up_a"], x["up_b"])
        return Mode({"a": Linear(ra), "b": Linear(Fraction(rb, 3))}, [
            rises("a+", "a", 0, {"up_a": True}), falls("a-", "a", 0, {"up_a": False}),
            rises("b+", "b", 0, {"up_b": True}), falls("b-", "b", 0, {"up_b": False}),
            rises("sum", {"a": 1, "b": Fraction(1, 2)}, 2, lambda x: {"sums": x["sums"] + 1})])

    facts = [Fact("up_a", "bool", "", ""), Fact("up_b", "bool", "", ""),
             Fact("sums", "int", "", "")]
    begin = {"a": start[0], "b": start[1], "up_a": start[0] >= 0, "up_b": start[1] >= 0, "sums": 0}
    plants = [Toy(begin, mode, *facts) for _ in range(2)]
    plants[0].advance(20 * S)
    for t_ns in sorted(stops):
        plants[1].advance(t_ns)
        plants[1].next_event_ns()
    plants[1].advance(20 * S)
    assert plants[0].snapshot() == plants[1].snapshot()
    # The oracle: exact rationals, event by event, instants rounded up to the ns.
    t, a, b = 0, Fraction(start[0]), Fraction(start[1])
    up, sums = [start[0] >= 0, start[1] >= 0], 0
    for _ in range(200):
        ra, rb = Fraction(corner(*up)[0], S), Fraction(corner(*up)[1], 3 * S)
        waits = [hit(a, ra, 0, 1), hit(a, ra, 0, -1), hit(b, rb, 0, 1), hit(b, rb, 0, -1),
                 hit(a + b / 2, ra + rb / 2, 2, 1)]
        dt = min(w for w in (*waits, 20 * S - t))
        t, a, b = t + dt, a + ra * dt, b + rb * dt
        up = [True if waits[0] == dt else False if waits[1] == dt else up[0],
              True if waits[2] == dt else False if waits[3] == dt else up[1]]
        sums += waits[4] == dt
        if t >= 20 * S:
            break
    assert (plants[0].state()["a"], plants[0].state()["b"]) == (float(a), float(b))
    assert plants[0].observe() == {"up_a": up[0], "up_b": up[1], "sums": sums}


def hit(value: Fraction, rate: Fraction, level: int, direction: int) -> int:
    """Whole ns until a level is passed in a direction; for ever if it is not."""
    way, speed = (level - value) * direction, rate * direction
    return math.ceil(way / speed) if way > 0 and speed > 0 else 10**30


def test_a_function_of_the_state_is_a_guard_too() -> None:
    def mode(x: dict[str, Any], on: Mapping[str, Any]) -> Mode:
        far = Guard("far", lambda x: math.hypot(x["a"], x["b"]), 5.0, 1, {"far": True})
        return Mode({"a": Linear(3), "b": Linear(4)}, (far,))
    plant = Toy({"a": 0, "b": 0, "far": False}, mode, Fact("far", "bool", "", ""))
    assert plant.next_event_ns() == pytest.approx(S, abs=1)


def test_alarms_come_at_their_instant() -> None:
    def mode(x: dict[str, Any], on: Mapping[str, Any]) -> Mode:
        return Mode({}, (Alarm("noon", 12 * S, {"rang": True}),))
    plant = Toy({"rang": False}, mode, Fact("rang", "bool", "", ""))
    assert crossings(plant, 20 * S) == [12 * S]


@settings(max_examples=15, deadline=None)
@given(script=st.lists(st.tuples(st.integers(0, 30 * S), st.sampled_from(["in", "out", "hot"]),
                                 st.booleans()), max_size=8),
       at_ns=st.integers(0, 30 * S))
def test_a_plant_restored_from_bytes_goes_on_bit_identically(
        script: list[tuple[int, str, bool]], at_ns: int) -> None:
    def mode(x: dict[str, Any], on: Mapping[str, Any]) -> Mode:
        flows: dict[str, Law] = {"heat": Approach(90.0 if on["hot"] else 20.0, 7.0)}
        if on["in"] and on["out"]:
            flows["level"] = Ode(lambda x: 0.5 - 0.4 * math.sqrt(max(x["level"], 0.0)))
        elif on["in"]:
            flows["level"] = Linear(0.5)
        elif on["out"] and x["level"] > 0:
            flows["level"] = Torricelli(0.4)
        return Mode(flows, (falls("empty", "level", 0, {"level": 0.0}),))

    def make() -> Toy:
        return Toy({"level": 0.0, "heat": 20.0}, mode, actuator("in", ""), actuator("out", ""),
                   actuator("hot", ""), gauge("level", "", high=20, resolution=1.0),
                   gauge("heat", "", high=100, resolution=5.0),
                   switch("full", "", of="level", at_least=3.0))
    plant, twin = make(), make()
    before = [step for step in sorted(script) if step[0] <= at_ns]
    after = [step for step in sorted(script) if step[0] > at_ns]
    for t_ns, name, value in before:
        plant.advance(t_ns)
        plant.actuate({name: value})
    plant.advance(at_ns)
    image.restore(twin, image.save(plant))
    assert image.save(twin) == image.save(plant)
    for one in (plant, twin):
        for t_ns, name, value in after:
            one.advance(t_ns)
            one.actuate({name: value})
        one.advance(40 * S)
    assert image.save(twin) == image.save(plant)
    assert crossings(twin, 41 * S) == crossings(plant, 41 * S)
