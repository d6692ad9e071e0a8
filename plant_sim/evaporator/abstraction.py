"""The evaporator as closed timed automata, after Figures 7 to 9 of the paper and its section 2.

Figures 7 to 9 show tank 1, tank 2 and the condenser. Steam and solution, which the paper names but
does not show, are one automaton here: boiling, steam that goes on, warm, solid. What the paper
leaves open:

* Whoever shuts V1 and V2 while tank 1 fills has a part of a filling, which takes at most the full
  time to be completed and counts as a whole one where it is poured onto something (so an overflow
  of tank 2 may be found that a smaller part would not cause; none is missed).
* Valves that let out what others let in: with V3 open nothing gathers in tank 1.
* Once the steam has ended the solution *may* become solid at any time from `solid_after_s` on.
* A full tank runs over at any time while a valve into it is open.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from math import isqrt

from plant_sim.abstraction import AbstractionError
from plant_sim.contract import Fact
from plant_sim.evaporator.parameters import EvaporatorParameters
from plant_sim.linear_automaton import Automaton, Location, Transition, location, transition
from plant_sim.parameters import ParameterError, Parameters, parameter
from plant_sim.timed import TimedNetwork, Truth

TORRICELLI = "torricelli"
_PER_S = 1000
"""Torricelli's time is enclosed between whole thousandths of a second."""

WET = ("cold", "boiling", "steaming", "warm")
TRUTHS = (
    Truth(Fact("tank1.overflow", "bool", "", "tank 1 has overflowed"), "tank1", ("overflow",)),
    Truth(Fact("tank2.overflow", "bool", "", "tank 2 has overflowed"), "tank2", ("overflow",)),
    Truth(Fact("explosion", "bool", "", "the condenser has exploded"), "condenser",
          ("explosion",)),
    Truth(Fact("solidified", "bool", "", "the solution in tank 1 has become solid"), "solution",
          ("solid",)),
    Truth(Fact("steam", "bool", "", "steam goes from tank 1 into the condenser"), "solution",
          ("boiling", "steaming")),
)


def _read_drain(found: object) -> str:
    """Return a drain time as text: `torricelli`, or one or two numbers of seconds."""
    text = f"{found[0]} to {found[-1]}" if isinstance(found, list) and found else str(found)
    if text.strip().lower() != TORRICELLI:
        _interval(text)
    return text.strip().lower()


def _interval(text: str) -> tuple[Fraction, Fraction]:
    try:
        ends = [Fraction(part.strip()) for part in text.split("to")]
    except (ValueError, ZeroDivisionError):
        ends = []
    if len(ends) not in (1, 2) or not 0 <= ends[0] <= ends[-1]:
        raise ValueError(f"seconds such as 2.258, an interval such as '2.258 to 2.259', or "
                         f"{TORRICELLI}")
    return ends[0], ends[-1]


@dataclass(frozen=True)
class Durations(Parameters):
    """What the abstraction takes besides the parameters of the plant."""

    fill_s: float = parameter(6.0, "filling tank 1 takes at most", unit="s", low=0.0, high=1e6)
    empty_s: float = parameter(26.0, "emptying tank 2 takes at most", unit="s", low=0.0, high=1e6)
    drain: str = parameter("0", "tank 1 drains within", unit="s", read=_read_drain)
    solid: str = parameter("any", "which solution may become solid: any, or that of a full tank 1 "
                           "that has not begun to drain", allowed=("any", "full"))


class EvaporatorAbstraction(TimedNetwork):
    """The evaporator in time.

    Args:
        parameters: `fill_s`, `empty_s`, `drain` and `solid` (see `Durations`), and those of the
            plant, of which `steam_after_s`, `solid_after_s` and `burst_s` count; `drain:
            torricelli` is the time that a full tank 1 needs with `A1`, `G1`, `Ht1` and `g`,
            between the thousandths of a second below and above it.

    Raises:
        AbstractionError: a parameter does not exist or cannot have its value.
    """

    def __init__(self, parameters: Mapping[str, object]) -> None:
        own = {row.name for row in Durations.table()}
        try:
            durations = Durations.of({k: v for k, v in parameters.items() if k in own})
            plant = EvaporatorParameters.of(
                {k: v for k, v in parameters.items() if k not in own}, besides=sorted(own))
        except ParameterError as problem:
            raise AbstractionError(str(problem)) from None
        drain = torricelli_s(plant) if durations.drain == TORRICELLI else \
            _interval(durations.drain)
        steam, burst = _exact(plant.steam_after_s), _exact(plant.burst_s)
        if burst < steam:
            raise AbstractionError(f"burst_s: found {burst}, expected at least steam_after_s, "
                                   f"{steam}: the condenser would burst whatever is done")
        super().__init__({
            "tank1": tank_1(_exact(durations.fill_s), *drain),
            "tank2": tank_2(_exact(durations.empty_s), drains_at_once=not drain[1]),
            "condenser": condenser(burst - steam, steam),
            "solution": solution(steam, _exact(plant.solid_after_s),
                                 ends_with_drain=bool(drain[1]) and durations.solid == "any"),
        }, TRUTHS)


def _exact(value: float) -> Fraction:
    """Return the number that was written."""
    return Fraction(str(value))


def torricelli_s(plant: EvaporatorParameters) -> tuple[Fraction, Fraction]:
    """Enclose the time in which a full tank 1 runs empty: sqrt(2 h / g) * ground / hole, in s."""
    square = 2 * _exact(plant.Ht1) / _exact(plant.g) * \
        (_exact(plant.G1) / _exact(plant.A1)) ** 2 * _PER_S ** 2
    low = isqrt(square.numerator // square.denominator)
    return Fraction(low, _PER_S), Fraction(low + (low * low < square), _PER_S)


# ---------------------------------------------------------------- the automata


def _place(name: str, clock: str = "", within: Fraction | None = None,
           **readings: bool) -> Location:
    """A location with at most one clock, which may have an upper bound there."""
    return location(name, {clock: 1} if clock else {},
                    f"{clock} <= {within}" if within is not None else "", [("", readings)])


def _at_command(source: str, target: str, label: str = "", sets: str = "", *, valve: str = "",
                **command: bool) -> Transition:
    """A transition that is taken when actuators have these values, or when a valve is open."""
    if valve:
        command[valve] = True
    return transition(source, target, label=label, sets={sets: 0} if sets else {},
                      command=command)


def tank_1(fill: Fraction, drain_low: Fraction, drain_high: Fraction) -> Automaton:
    """Figure 7, with parts of a filling; draining takes its time if that is not zero."""
    places = [_place("empty", T1E=True), _place("filling", "t1", fill), _place("part"),
              _place("brimming", T1F=True), _place("full", T1F=True),
              _place("overflow", T1F=True)]
    moves = [_at_command("empty", "filling", "fill", "t1", V1=True, V3=False),
             _at_command("empty", "filling", "fill", "t1", V2=True, V3=False)]
    if drain_high:
        places += [_place("draining", "t1", drain_high), _place("draining a part", "t1",
                                                               drain_high)]
        moves += [
            transition("draining", "empty", f"t1 >= {drain_low}", label="tank 1 is empty"),
            transition("draining a part", "empty", label="the rest of tank 1 has drained"),
            _at_command("draining", "part", "drain stops", V3=False),
            _at_command("draining a part", "part", "drain stops", V3=False)]
    whole, part = ("draining", "draining a part") if drain_high else ("empty", "empty")
    clock = "t1" if drain_high else ""
    for source, target, label in (("brimming", whole, "drain"), ("full", whole, "drain"),
                                  ("filling", part, "drain a part"),
                                  ("part", part, "drain a part")):
        moves.append(_at_command(source, target, label, clock, V3=True))
    moves += [
        transition("filling", "brimming", label="tank 1 is full"),
        _at_command("filling", "part", V1=False, V2=False),
        transition("brimming", "overflow", label="tank 1 runs over"),
        _at_command("brimming", "full", V1=False, V2=False),
        *(_at_command("full", "brimming", valve=valve) for valve in ("V1", "V2")),
        *(_at_command("part", "filling", "fill", "t1", valve=valve) for valve in ("V1", "V2"))]
    return Automaton(tuple(places), tuple(moves), "empty", ())


def tank_2(empty: Fraction, drains_at_once: bool) -> Automaton:
    """Figure 8; what comes onto something else is an overflow."""
    places = [_place("empty", T2E=True), _place("full", T2F=True), _place("some"),
              _place("emptying", "t2", empty), _place("overflow", T2F=True)]
    moves = [_at_command("full", "emptying", sets="t2", V4=True),
             _at_command("some", "emptying", sets="t2", V4=True),
             _at_command("emptying", "some", V4=False),
             transition("emptying", "empty", label="tank 2 is empty")]
    held = {"empty": {"drain": "full", "drain a part": "some"}}
    if not drains_at_once:
        places += [_place("receiving"), _place("flowing through")]
        held = {"empty": dict.fromkeys(("drain", "drain a part"), "receiving"),
                "receiving": {"tank 1 is empty": "full", "the rest of tank 1 has drained": "some",
                              "drain stops": "some"},
                "flowing through": dict.fromkeys(
                    ("tank 1 is empty", "the rest of tank 1 has drained", "drain stops"),
                    "emptying")}
        moves += [_at_command("receiving", "flowing through", V4=True),
                  _at_command("flowing through", "receiving", V4=False)]
    moves += [transition(source, target, label=label,
                         sets={"t2": 0} if target == "emptying" else {})
              for source, rows in held.items() for label, target in rows.items()]
    labels = dict.fromkeys(label for rows in held.values() for label in rows)
    moves += [transition(source, "overflow", label=label)
              for source in ("full", "some", "emptying") for label in ("drain", "drain a part")]
    moves += [transition("overflow", "overflow", label=label) for label in labels]
    return Automaton(tuple(places), tuple(moves), "empty", ())


def condenser(bears: Fraction, steam: Fraction) -> Automaton:
    """Figure 9: what has been heated for too long under a failure explodes whatever is done."""
    places = [_place("good"), _place("malfunction_not_heater", Malf=True),
              _place("malfunction_heater", "c", bears, Malf=True),
              _place("before_explosion", "c", steam, Malf=True), _place("explosion", Malf=True)]
    moves = [
        transition("good", "malfunction_not_heater", label="the condenser fails"),
        *(transition(source, "good", label="the condenser works again")
          for source in ("malfunction_not_heater", "malfunction_heater")),
        _at_command("malfunction_not_heater", "malfunction_heater", sets="c", H=True),
        _at_command("malfunction_heater", "malfunction_not_heater", H=False),
        transition("malfunction_heater", "before_explosion", f"c >= {bears}", {"c": 0},
                   "the explosion can no longer be avoided"),
        transition("before_explosion", "explosion", f"c >= {steam}",
                   label="the condenser explodes")]
    return Automaton(tuple(places), tuple(moves), "good", ())


def solution(steam: Fraction, solid: Fraction, ends_with_drain: bool) -> Automaton:
    """What is in tank 1: it boils, steams on, cools, becomes solid; a solid does not drain.

    It counts until the drain ends, or only until it begins.
    """
    places = [_place("none"), _place("cold"), _place("boiling"), _place("steaming", "h", steam),
              _place("warm", "h"), _place("solid")]
    moves = [
        transition("none", "cold", label="fill"),
        *(transition(place, place, label="fill") for place in (*WET, "solid")),
        *(_at_command(source, "boiling", H=True) for source in ("cold", "steaming", "warm")),
        _at_command("boiling", "steaming", sets="h", H=False),
        transition("steaming", "warm", f"h >= {steam}", {"h": 0}, "the steam ends"),
        transition("warm", "solid", f"h >= {solid}", label="the solution becomes solid")]
    begins = ("drain", "drain a part")
    ends = ("tank 1 is empty", "the rest of tank 1 has drained") if ends_with_drain else begins
    moves += [transition(place, "none", label=label) for place in WET for label in ends]
    through = (*WET, "none") if ends_with_drain else ("none",)
    moves += [transition(place, place, label=label) for place in through for label in begins]
    if ends_with_drain:
        moves += [transition("solid", "solid", label=label) for label in ends]
    return Automaton(tuple(places), tuple(moves), "none", ())
