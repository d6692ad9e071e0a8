"""The evaporator against closed forms: Torricelli's law, and the durations of the paper."""

from __future__ import annotations

import math
from typing import Any

import pytest
from scipy.integrate import solve_ivp

from plant_sim.evaporator import Evaporator

S = 1_000_000_000
G = 9.80665
SWITCHES = ("T1E", "T1F", "T2E", "T2F")


def emptying_s(area: float, level: float = 1.0) -> float:
    """The time in which a tank of 1 m2 runs empty (Torricelli)."""
    return 2 * math.sqrt(level) / (area * math.sqrt(2 * G))


def plant_after_filling(**parameters: Any) -> Evaporator:
    """An evaporator whose tank 1 is just full, with all valves closed."""
    plant = Evaporator(parameters)
    plant.watch(SWITCHES)
    plant.actuate({"V1": True, "V2": True})
    plant.advance(1)
    full_ns = plant.next_event_ns()
    assert full_ns is not None
    plant.advance(full_ns)
    plant.actuate({"V1": False, "V2": False})
    return plant


def run(plant: Evaporator, seconds: float) -> Evaporator:
    plant.advance(plant.t_ns + round(seconds * S))
    return plant


def events(plant: Evaporator, until_s: float) -> list[tuple[int, str, bool]]:
    """Changes of the switches as (ns, switch, value)."""
    found, before = [], plant.sense()
    while (t_ns := plant.next_event_ns()) is not None and t_ns <= until_s * S:
        plant.advance(t_ns)
        now = plant.sense()
        found += [(t_ns, name, bool(now[name])) for name in SWITCHES if now[name] != before[name]]
        before = now
    return found


def test_tank_1_is_full_after_two_thirds_of_a_second() -> None:
    assert plant_after_filling().t_ns == math.ceil(2e9 / 3)


@pytest.mark.parametrize("area", [0.2, 0.05, 0.017])
def test_a_tank_runs_empty_in_torricellis_time(area: float) -> None:
    plant = plant_after_filling(A1=area)
    begin, level = plant.t_ns, plant.state()["tank1.level"]
    plant.actuate({"V3": True})
    empty = next(t for t, name, value in events(plant, 100.0) if (name, value) == ("T1E", True))
    assert (empty - begin) / S == pytest.approx(emptying_s(area, level), abs=1.1e-9)


def test_what_leaves_tank_1_is_in_tank_2() -> None:
    plant = plant_after_filling()
    plant.actuate({"V3": True})
    for _ in range(20):
        run(plant, 0.1)
        state = plant.state()
        assert state["tank1.level"] + state["tank2.level"] == pytest.approx(1.0, abs=1e-8)


def test_two_open_valves_in_a_row_agree_with_scipy() -> None:
    plant = plant_after_filling()
    begin = plant.t_ns
    plant.actuate({"V3": True, "V4": True})
    found = {(name, value): t - begin for t, name, value in events(plant, 60.0)}
    k1, k2 = 0.2 * math.sqrt(2 * G), 0.05 * math.sqrt(2 * G)

    def slopes(_: float, y: Any) -> list[float]:
        out1, out2 = (k * math.sqrt(max(v, 0.0)) for k, v in zip((k1, k2), y, strict=True))
        return [-out1, out1 - out2]

    t1_s = emptying_s(0.2)
    until = solve_ivp(slopes, (0.0, t1_s), [1.0, 0.0], rtol=1e-12, atol=1e-14, max_step=0.01)
    oracle_s = t1_s + emptying_s(0.05, until.y[1][-1])
    assert found[("T1E", True)] / S == pytest.approx(t1_s, abs=1e-8)
    assert found[("T2E", True)] / S == pytest.approx(oracle_s, abs=1e-6)


def test_filling_while_it_drains_agrees_with_scipy() -> None:
    plant = Evaporator({"A1": 0.3, "brim": 1.0})
    plant.actuate({"V1": True, "V3": True})
    run(plant, 1.5)
    k = 0.3 * math.sqrt(2 * G)
    oracle = solve_ivp(lambda _, y: [1.0 - k * math.sqrt(max(y[0], 0.0))], (0, 1.5), [0.0],
                       method="LSODA", rtol=1e-12, atol=1e-13)
    assert plant.state()["tank1.level"] == pytest.approx(oracle.y[0][-1], abs=1e-8)


def test_steam_ends_12_s_after_the_heater_and_the_concentrate_is_solid_19_s_later() -> None:
    plant = plant_after_filling()
    plant.actuate({"H": True})
    run(plant, 20.0)
    assert plant.observe()["steam"] is True
    plant.actuate({"H": False})
    begin = plant.t_ns
    ends = {}
    for what in ("steam", "solidified"):
        t_ns = plant.next_event_ns()
        assert t_ns is not None
        plant.advance(t_ns)
        ends[what] = t_ns - begin
    assert ends == {"steam": 12 * S, "solidified": 31 * S}
    assert plant.observe()["solidified"] is True
    plant.actuate({"V3": True})
    assert run(plant, 10.0).state()["tank1.level"] > 0.99


def test_fresh_solution_never_becomes_solid() -> None:
    assert run(plant_after_filling(), 1000.0).observe()["solidified"] is False


@pytest.mark.parametrize(("heated_s", "explodes"), [(9.9, False), (10.1, True), (30.0, True)])
def test_the_condenser_explodes_after_22_s_of_steam_without_cooling(heated_s: float,
                                                                    explodes: bool) -> None:
    plant = plant_after_filling()
    plant.disturb({"condenser.malfunction": True})
    plant.actuate({"H": True})
    run(plant, heated_s)
    plant.actuate({"H": False})
    assert run(plant, 60.0).observe()["explosion"] is explodes


def test_the_explosion_is_at_its_nanosecond() -> None:
    plant = plant_after_filling()
    plant.actuate({"H": True})
    run(plant, 3.0)
    plant.disturb({"condenser.malfunction": True})
    begin = plant.t_ns
    plant.advance(begin + 22 * S - 1)
    assert plant.observe()["explosion"] is False
    plant.advance(begin + 22 * S)
    assert plant.observe()["explosion"] is True


def test_a_repaired_condenser_relieves_the_pressure() -> None:
    plant = plant_after_filling()
    plant.actuate({"H": True})
    plant.disturb({"condenser.malfunction": True})
    run(plant, 20.0)
    plant.disturb({"condenser.malfunction": False})
    assert run(plant, 100.0).state()["condenser.pressure"] == 1.0
    assert plant.observe()["explosion"] is False


def test_tank_1_overflows_at_its_brim() -> None:
    plant = Evaporator()
    plant.actuate({"V1": True})
    plant.advance(1_099_999_999)
    assert plant.observe()["tank1.overflow"] is False
    plant.advance(1_100_000_001)
    assert plant.observe()["tank1.overflow"] is True
    assert run(plant, 10.0).state()["tank1.level"] == pytest.approx(1.1)


def test_tank_2_overflows_when_a_second_filling_comes_too_early() -> None:
    plant = plant_after_filling()
    for _ in range(2):
        plant.actuate({"V3": True})
        run(plant, 3.0)
        plant.actuate({"V3": False, "V1": True})
        run(plant, 1.0)
        plant.actuate({"V1": False})
    assert plant.observe()["tank2.overflow"] is True


def test_a_leak_empties_a_tank_and_fills_no_other() -> None:
    plant = plant_after_filling()
    begin, level = plant.t_ns, plant.state()["tank1.level"]
    plant.disturb({"tank1.leak": 0.05})
    empty = next(t for t, name, value in events(plant, 100.0) if (name, value) == ("T1E", True))
    assert (empty - begin) / S == pytest.approx(emptying_s(0.05, level), abs=1.1e-9)
    assert plant.state()["tank2.level"] == 0.0


def test_heating_up_takes_its_time_where_it_is_set() -> None:
    plant = plant_after_filling(heat_up_s=8.0)
    plant.actuate({"H": True})
    begin = plant.t_ns
    t_ns = plant.next_event_ns()
    assert t_ns is not None
    plant.advance(t_ns)
    assert plant.observe()["steam"] is True
    assert t_ns - begin == pytest.approx(8.0 * S * (88 - 20) / (100 - 20), abs=1)
