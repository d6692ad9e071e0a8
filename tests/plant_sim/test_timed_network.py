"""Networks of closed timed automata as finite plants."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

import pytest

from plant_sim.abstraction import AbstractionError, load_abstraction
from plant_sim.contract import Fact
from plant_sim.free_inputs import FreeInputs
from plant_sim.linear_automaton import Automaton, AutomatonError, location, transition
from plant_sim.timed import TimedNetwork, Truth, in_time


def lamp(**more: Any) -> Automaton:
    """On command it lights up, and goes out by itself within 2 to 3 s."""
    return Automaton(
        (location("dark", {}), location("lit", {"x": 1}, "x <= 3", [("", {"bright": True})])),
        (transition("dark", "lit", sets={"x": 0}, command={"switch": True}, label="lights"),
         transition("lit", "dark", "x >= 2", label="goes out")), "dark", (), **more)


COUNTER = Automaton(
    (location("none", {}), location("one", {})),
    (transition("none", "one", label="goes out"), transition("one", "one", label="goes out")),
    "none", ())
NETWORK = TimedNetwork({"lamp": lamp(), "counter": COUNTER},
                       [Truth(Fact("went_out", "bool", "", ""), "counter", ("one",))])


def lit() -> Any:
    return NETWORK.settled(NETWORK.actuate(next(iter(NETWORK.initial())), {"switch": True}))


def test_a_command_takes_its_transition_at_once_and_sets_the_clock() -> None:
    state = NETWORK.actuate(next(iter(NETWORK.initial())), {"switch": True})
    assert state.locations == ("lit", "none") and "x" in NETWORK.restarted(state)
    assert NETWORK.sense(state) == {"bright": True}


def test_what_happens_by_itself_is_bounded_by_guard_and_invariant() -> None:
    action, = NETWORK.actions(lit())
    assert str(action) == "goes out"
    assert NETWORK.guard(lit(), action) == {"x": (Fraction(2), None)}
    assert NETWORK.latest(lit()) == {"x": Fraction(3)}
    assert set(NETWORK.running(lit())) == {"x"}


def test_automata_that_know_a_label_move_together() -> None:
    after = NETWORK.after(lit(), NETWORK.actions(lit())[0])
    assert after.locations == ("dark", "one")
    assert NETWORK.observe(after) == {"went_out": True, "bright": False}


def test_a_label_is_blocked_where_one_that_knows_it_cannot_take_it() -> None:
    never = Automaton((location("shut", {}), location("open", {})),
                      (transition("open", "shut", label="goes out"),), "shut", ())
    network = TimedNetwork({"lamp": lamp(), "gate": never})
    state = network.actuate(next(iter(network.initial())), {"switch": True})
    assert network.actions(state) == []


def test_all_constants_of_a_clock_are_told() -> None:
    assert {k: set(v) for k, v in NETWORK.constants().items()} == {"x": {2, 3}}


def automaton(invariant: str = "", guard: str = "", rate: int = 1,
              sets: Mapping[str, int] | None = None,
              command: Mapping[str, bool] | None = None) -> Automaton:
    place = location("a", {"x": rate, "y": 1}, invariant)
    return Automaton((place,), (transition("a", "a", guard, sets, command=command),), "a", ())


@pytest.mark.parametrize(("wrong", "told"), [
    ({"guard": "x < 2"}, "open"), ({"invariant": "x < 2"}, "open"),
    ({"guard": "x - y <= 2"}, "one clock"), ({"invariant": "x >= 2"}, "from above"),
    ({"rate": 2}, "no clock"), ({"sets": {"x": 1}}, "set to 0"),
    ({"guard": "x >= 1", "command": {"v": True}}, "at once")])
def test_what_is_no_closed_timed_automaton_is_refused(wrong: dict[str, Any], told: str) -> None:
    with pytest.raises(AutomatonError, match=told):
        TimedNetwork({"it": automaton(**wrong)})


def test_commands_that_lead_on_without_end_are_refused() -> None:
    network = TimedNetwork({"it": automaton(command={"v": True})})
    with pytest.raises(AutomatonError, match="without end"):
        network.actuate(next(iter(network.initial())), {"v": True})


def test_a_plant_without_clocks_does_what_it_may_at_any_time() -> None:
    plant = in_time(FreeInputs({"a": [False, True]}))
    state = next(iter(plant.initial()))
    action, = plant.actions(state)
    assert plant.guard(state, action) == plant.latest(state) == {} and not plant.clocks


@pytest.mark.parametrize(("wrong", "told"), [
    ({"drain": "soon"}, "torricelli"), ({"drain": "3 to 2"}, "drain"), ({"fil_s": 3}, "fill|known"),
    ({"burst_s": 5}, "burst_s"), ({"empty_s": -1}, "empty_s")])
def test_a_wrong_parameter_of_the_evaporator_is_named(wrong: dict[str, object], told: str) -> None:
    with pytest.raises(AbstractionError, match=told):
        load_abstraction("evaporator", wrong)
