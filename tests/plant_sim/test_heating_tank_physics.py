"""The heating tank's physics, beside closed forms and scipy's integrator."""

import math

import pytest
from scipy.integrate import solve_ivp

from plant_sim.heating_tank.plant import HEAT_CAPACITY_KJ, HeatingTank

S = 1_000_000_000


def tank(**parameters):
    return HeatingTank({"start_at_s": 0, **parameters})


def after(plant, seconds, **actuators):
    plant.actuate(actuators)
    plant.advance(plant.t_ns + round(seconds * S))
    return plant.state()


def event_ns(plant, sensor):
    """When a sensor changes, the actuators staying as they are."""
    before = plant.sense()[sensor]
    plant.watch([sensor])
    while plant.sense()[sensor] == before:
        plant.advance(plant.next_event_ns())
    return plant.t_ns


def test_it_is_full_when_the_inflow_has_filled_it():
    plant = tank(inflow_l_s=0.4, full_l=20)
    plant.actuate({"o1": True})
    assert event_ns(plant, "i2") == 50 * S


def test_it_empties_by_torricelli_s_law():
    plant = tank()
    after(plant, 20, o1=True)
    plant.actuate({"o1": False, "o2": True})
    begin = plant.t_ns
    lower_ns = event_ns(plant, "i1") - begin
    assert lower_ns == pytest.approx(20 * (1 - math.sqrt(0.5 / 20)) * S, rel=1e-6)


def test_the_closed_tank_warms_exponentially_towards_the_balance_with_its_losses():
    plant = tank(loss_W_K=400, power_kW=20)
    start = after(plant, 20, o1=True)["temperature"]
    hot = after(plant, 60, o1=False, o3=True, o4=True)["temperature"]
    target, tau = 20 + 20 / 0.4, HEAT_CAPACITY_KJ * 21 / 0.4
    assert hot == pytest.approx(target + (start - target) * math.exp(-60 / tau), rel=1e-9)


def test_filling_with_the_heater_on_agrees_with_an_independent_integrator():
    plant = tank(loss_W_K=400, power_kW=30)
    warm = after(plant, 15, o1=True, o3=True, o4=True)["temperature"]

    def rate(t, y):
        return [(1.0 * (15 - y[0]) + (30 - 0.4 * (y[0] - 20)) / HEAT_CAPACITY_KJ) / (t + 1.0)]

    expected = solve_ivp(rate, (0, 15), [20.0], rtol=1e-10, atol=1e-10).y[0][-1]
    assert warm == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("pieces", [2, 6, 60])
def test_how_time_is_cut_changes_nothing(pieces):
    whole, cut = tank(), tank()
    for plant, parts in ((whole, 1), (cut, pieces)):
        for actuators in ({"o1": True}, {"o1": False, "o3": True, "o4": True}, {"o2": True}):
            for _ in range(parts):
                after(plant, 12 / parts, **actuators)
    assert whole.t_ns == cut.t_ns
    assert whole.state() == cut.state()


def test_the_operator_presses_and_lets_go():
    plant = tank(start_at_s=1, start_every_s=10, press_s=0.5, stop_at_s=3)
    changes = []
    plant.watch(["i4", "i5"])
    while (event := plant.next_event_ns()) is not None and event < 12 * S:
        plant.advance(event)
        changes.append((event / S, plant.sense()["i4"], plant.sense()["i5"]))
    assert changes == [(1.0, True, False), (1.5, False, False), (3.0, False, True),
                       (3.5, False, False), (11.0, True, False), (11.5, False, False)]


@pytest.mark.parametrize(("fact", "actuators", "seconds"), [
    ("overflow", {"o1": True}, 26), ("dry_heating", {"o4": True}, 1),
    ("boiled", {"o1": False, "o3": True, "o4": True}, 400)])
def test_what_should_not_happen_is_a_fact(fact, actuators, seconds):
    plant = tank()
    after(plant, 10 * (fact == "boiled"), o1=True)
    assert plant.observe()[fact] is False
    after(plant, seconds, **{"o1": False, **actuators})
    assert plant.observe()[fact] is True


def test_a_batch_is_a_full_tank_that_was_heated_and_emptied():
    plant = tank()
    after(plant, 20, o1=True)
    after(plant, 120, o1=False, o3=True, o4=True)
    after(plant, 25, o4=False, o2=True)
    assert plant.observe()["batches"] == 1


def test_a_snapshot_goes_on_as_the_plant_itself():
    plant = tank(start_at_s=1)
    after(plant, 7, o1=True)
    twin = tank(start_at_s=1)
    twin.restore(plant.snapshot())
    assert after(plant, 20, o3=True) == after(twin, 20, o3=True)
