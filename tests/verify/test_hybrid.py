"""Exact reachability: classical systems with known answers, and a conveyor in closed form."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from math import ceil, floor

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plant_sim.linear_automaton import (
    Automaton,
    AutomatonError,
    compose,
    location,
    objective,
    transition,
)
from plcemu.verify.hybrid.polyhedra import Bounds
from plcemu.verify.hybrid.reach import Cyclic, Values, reach

F = Fraction


def water_level() -> Automaton:
    """The water level monitor of Alur et al. (1995): a pump reacts 2 s late."""
    return Automaton(
        (location("filling", {"x": 1, "w": 1}, "w <= 10"),
         location("switching off", {"x": 1, "w": 1}, "x <= 2"),
         location("draining", {"x": 1, "w": -2}, "w >= 5"),
         location("switching on", {"x": 1, "w": -2}, "x <= 2")),
        (transition("filling", "switching off", "w == 10", {"x": 0}),
         transition("switching off", "draining", "x == 2"),
         transition("draining", "switching on", "w == 5", {"x": 0}),
         transition("switching on", "filling", "x == 2")),
        "filling", location("", {"w": 1}, "w == 1").invariant,
        (objective("highest", "draining", "w"), objective("lowest", "filling", "w")))


def test_the_water_level_stays_between_1_and_12() -> None:
    found = reach(water_level())
    assert found.conclusive
    assert found.kind == "polyhedra"
    assert found.bounds("highest") == Bounds(F(12), F(12))
    assert found.bounds("lowest") == Bounds(F(1), F(1))


def test_a_rate_within_an_interval_widens_the_level() -> None:
    automaton = Automaton(
        (location("run", {"t": 1, "w": (F(-1, 2), 3)}, "t <= 4"), location("end", {"w": 0})),
        (transition("run", "end", "t == 4"),), "run",
        location("", {"t": 1, "w": 1}, "t == 0 & 1 <= w < 2").invariant,
        (objective("level", "end", "w"),))
    assert reach(automaton).bounds("level") == Bounds(F(-1), F(14), True, False)


def test_an_automaton_that_never_repeats_is_not_conclusive() -> None:
    automaton = Automaton(
        (location("a", {"x": 1, "n": 0}, "x <= 1"),),
        (transition("a", "a", "x == 1", {"x": 0}),), "a",
        location("", {"x": 1, "n": 1}, "x == 0 & n >= 0").invariant)
    assert reach(automaton).conclusive
    counting = Automaton(
        (location("a", {"x": 1, "total": 1}, "x <= 1"),),
        (transition("a", "a", "x == 1", {"x": 0}),), "a",
        location("", {"x": 1, "total": 1}, "x == 0 & total == 0").invariant)
    found = reach(counting, limit=50)
    assert not found.conclusive
    assert "50 symbolic states" in found.reason


def test_composed_automata_move_together_on_common_labels() -> None:
    clock = Automaton((location("wait", {"c": 1}, "c <= 3"), location("done", {})),
                      (transition("wait", "done", "c >= 2", label="ring"),), "wait",
                      location("", {"c": 1}, "c == 0").invariant)
    cart = Automaton((location("go", {"s": 5}), location("stop", {"s": 0})),
                     (transition("go", "stop", label="ring"),), "go",
                     location("", {"s": 1}, "s == 0").invariant,
                     (objective("way", "stop", "s"),))
    found = reach(compose(clock, cart))
    assert found.bounds("way") == Bounds(F(10), F(15))
    assert "wait.stop" not in found.locations


# ------------------------------------------------------------ under a cyclic controller

WAY = F(80)


def conveyor(slowest: Fraction, fastest: Fraction, exact_return: bool = False) -> Automaton:
    """A conveyor at a constant unknown speed, in time under way and time since the sensor."""
    back = {"d": 1} if exact_return else {}
    return Automaton(
        (location("load", {}, readings=[("", {"at_load": True})]),
         location("moving", {"tau": 1, "y": 1}, readings=[("y >= 0", {"at_test": True})]),
         location("test", {}, readings=[("", {"at_test": True})]),
         location("returning", back, "d <= 3500" if exact_return else "")),
        (transition("load", "moving", sets={"tau": 0, "y": (-WAY / slowest, -WAY / fastest)},
                    command={"forward": True}),
         transition("moving", "test", command={"forward": False}),
         transition("test", "returning", sets={"d": 0} if exact_return else {},
                    command={"back": True}),
         transition("returning", "load", "3000 <= d" if exact_return else "")),
        "load", (), (objective("stop", "test", "80*tau", "tau - y", "mm"),))


class Stepper:
    """A controller with three steps."""

    def start(self) -> str:
        return "go"

    def scan(self, state: object, inputs: Mapping[str, bool]) -> tuple[str, Values]:
        table = {("go", True, False): "hold", ("go", True, True): "hold",
                 ("hold", True, False): "back", ("hold", False, False): "back",
                 ("back", False, True): "go", ("back", True, True): "go"}
        key = str(state), inputs.get("at_test", False), inputs.get("at_load", False)
        following = table.get(key, str(state))
        return following, (("forward", following == "go"), ("back", following == "back"))


def closed_form(speed: Fraction, shortest: Fraction,
                longest: Fraction) -> tuple[Fraction, Fraction]:
    """Return where a conveyor of one speed stops, by counting cycles.

    The sensor is seen at the first end of a cycle not before the arrival, the n-th; the conveyor
    stops one cycle later.
    """
    arrival = WAY / speed
    first, last = ceil(arrival / longest), floor(arrival / shortest) + 1
    low = high = None
    for n in range(first, last + 1):
        early, late = max(n * shortest, arrival), min(n * longest, arrival + longest)
        if early > late or (n - 1) * shortest >= arrival:
            continue
        stops = speed * (early + shortest), speed * (late + longest)
        low = stops[0] if low is None else min(low, stops[0])
        high = stops[1] if high is None else max(high, stops[1])
    assert low is not None and high is not None
    return low, high


def test_the_paper_s_check_value_is_reproduced() -> None:
    period = F(11) * F(995, 1000), F(11) * F(1005, 1000)
    found = reach(conveyor(F(1, 5), F(1, 5)), Cyclic(Stepper(), period))
    assert found.conclusive and found.kind == "zones"
    assert found.bounds("stop") == Bounds(F("83.182"), F("84.018"))


@settings(max_examples=25, deadline=None)
@given(st.integers(200, 1500), st.integers(0, 20), st.integers(150, 250))
def test_one_speed_stops_where_counting_cycles_says(
        hundredths: int, jitter: int, speed: int) -> None:
    cycle, v = F(hundredths, 100), F(speed, 1000)
    period = cycle * (1 - F(jitter, 1000)), cycle * (1 + F(jitter, 1000))
    found = reach(conveyor(v, v), Cyclic(Stepper(), period)).bounds("stop")
    assert found is not None
    assert (found.low, found.high) == closed_form(v, *period)


@pytest.mark.parametrize("speeds", [("0.2", "0.2"), ("0.195", "0.205")])
def test_zones_and_polyhedra_reach_the_same(speeds: tuple[str, str]) -> None:
    automaton = conveyor(F(speeds[0]), F(speeds[1]))
    cyclic = Cyclic(Stepper(), (F("59.7"), F("60.3")))
    quick = reach(automaton, cyclic, kind="zones")
    general = reach(automaton, cyclic, kind="polyhedra")
    assert quick.pieces("stop") == general.pieces("stop")
    assert quick.conclusive and general.conclusive


def test_the_return_s_duration_does_not_change_where_it_stops() -> None:
    period = F("12.935"), F("13.065")
    exact = reach(conveyor(F("0.199"), F("0.201"), exact_return=True), Cyclic(Stepper(), period))
    free = reach(conveyor(F("0.199"), F("0.201")), Cyclic(Stepper(), period))
    assert exact.conclusive
    assert exact.pieces("stop") == free.pieces("stop")


def test_without_jitter_an_arrival_at_the_end_of_a_cycle_is_seen_then() -> None:
    found = reach(conveyor(F(1, 5), F(1, 5)), Cyclic(Stepper(), (F(10), F(10))))
    assert found.bounds("stop") == Bounds(F(82), F(82))


def test_a_commanded_transition_with_a_guard_is_refused() -> None:
    automaton = Automaton((location("a", {"x": 1}),),
                          (transition("a", "a", "x > 1", command={"go": True}),), "a", ())
    with pytest.raises(AutomatonError, match="has no guard"):
        reach(automaton, Cyclic(Stepper(), (F(1), F(1))))


def test_a_cycle_without_duration_is_refused() -> None:
    with pytest.raises(AutomatonError, match="cycle of 0 to 1"):
        reach(conveyor(F(1), F(1)), Cyclic(Stepper(), (F(0), F(1))))


def test_a_location_that_does_not_exist_is_named() -> None:
    with pytest.raises(AutomatonError, match="'b'"):
        Automaton((location("a", {}),), (transition("a", "b"),), "a", ())
