"""Devices and faults around a plant: noise, delay, drift, travel, and what each fault does."""

from __future__ import annotations

import json
import statistics
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plant_sim.batch_plant import BatchPlant
from plant_sim.devices import Device
from plant_sim.evaporator import Evaporator
from plant_sim.faults import Injection
from plant_sim.rig import Rig

S, MS = 1_000_000_000, 1_000_000
LEVEL = "B1.level"


def rig(*faults: Injection, seed: int = 1, **devices: Device) -> Rig:
    """A batch plant with one unit in B1 behind devices; `B1_level` stands for `B1.level`."""
    named = {name.replace("_", "."): device for name, device in devices.items()}
    return Rig(BatchPlant({"tanks": "B1=sol42C"}), named, faults, seed)


def readings(one: Rig, sensor: str, instants: list[int]) -> list[Any]:
    found = []
    for t_ns in instants:
        one.advance(t_ns)
        found.append(one.sense()[sensor])
    return found


def test_without_devices_and_faults_a_rig_is_the_plant() -> None:
    bare, through = BatchPlant({"tanks": "B1=sol42C"}), rig()
    for one in (bare, through):
        one.actuate({"V8": True})
        one.advance(100 * S)
    assert through.sense() == bare.sense()
    assert through.next_event_ns() == bare.next_event_ns()


def test_noise_depends_on_seed_and_instant_only() -> None:
    device = Device(noise=0.5, sample_ns=100 * MS)
    instants = [k * 37 * MS for k in range(60)]
    often, seldom = rig(B1_level=device), rig(B1_level=device)
    values = readings(often, LEVEL, instants)
    assert readings(seldom, LEVEL, instants[::7]) == values[::7]
    assert readings(rig(B1_level=device, seed=2), LEVEL, instants) != values
    assert len({v for t, v in zip(instants, values, strict=True) if t < 100 * MS}) == 1


def test_noise_has_the_mean_and_deviation_asked_for() -> None:
    one = rig(B1_level=Device(noise=0.5, sample_ns=MS))
    values = readings(one, LEVEL, [k * MS for k in range(2000)])
    assert statistics.mean(values) == pytest.approx(4.2, abs=0.05)
    assert statistics.stdev(values) == pytest.approx(0.5, abs=0.05)


def test_a_delayed_sensor_reads_what_was() -> None:
    plain, late = rig(), rig(B1_level=Device(delay_ns=3 * S))
    for one in (plain, late):
        one.actuate({"V8": True})
    instants = [k * S for k in range(60)]
    assert readings(late, LEVEL, instants)[3:] == readings(plain, LEVEL, instants)[:-3]


def test_a_drift_shows_at_its_nanosecond() -> None:
    one = rig(B1_level=Device(drift_per_s=0.01))
    one.watch([LEVEL])
    assert one.next_event_ns() == 5 * S
    assert readings(one, LEVEL, [5 * S - 1, 5 * S, 15 * S]) == [4.2, 4.3, 4.4]


def test_a_coarse_sensor_reads_whole_resolutions() -> None:
    assert readings(rig(B1_level=Device(resolution=0.5)), LEVEL, [0]) == [4.0]


def test_a_valve_with_travel_opens_and_closes_late_and_may_turn_back() -> None:
    one = rig(V8=Device(travel_ns=2 * S))
    plant: Any = one.plant
    script = {0: True, 1 * S: False, 4 * S: True, 10 * S: False}
    seen = {}
    for t_ns in sorted({*script, 3 * S, 6 * S - 1, 6 * S, 12 * S - 1, 12 * S}):
        one.advance(t_ns)
        one.actuate({"V8": script[t_ns]} if t_ns in script else {})
        seen[t_ns] = plant.actuators["V8"]
    assert [t_ns for t_ns, is_open in seen.items() if is_open] == [6 * S, 10 * S, 12 * S - 1]


FAULTY = [
    (Injection(10 * S, LEVEL, "stuck"), LEVEL, 4.1),
    (Injection(10 * S, LEVEL, "stuck", 2.0), LEVEL, 2.0),
    (Injection(10 * S, LEVEL, "lost"), LEVEL, 0.0),
    (Injection(10 * S, LEVEL, "open"), LEVEL, 0.0),
    (Injection(10 * S, LEVEL, "offset", 1.0), LEVEL, 3.9),
    (Injection(10 * S, LEVEL, "drift", 0.01), LEVEL, 3.8),
    (Injection(10 * S, LEVEL, "wrong sign"), LEVEL, 6.0),
    (Injection(10 * S, LEVEL, "slow", 100.0), LEVEL, 4.1),
    (Injection(0, "V8", "closed"), LEVEL, 4.2),
    (Injection(0, "V8", "wrong_sign"), LEVEL, 4.2),
    (Injection(0, "V8", "slow", 50.0), LEVEL, 3.6),
    (Injection(0, "B1", "leak", 0.01), LEVEL, 1.9),
]


@pytest.mark.parametrize(("fault", "sensor", "reading"), FAULTY,
                         ids=[f"{f.target} {f.fault}" for f, _, _ in FAULTY])
def test_each_fault_does_what_the_table_says(fault: Injection, sensor: str,
                                             reading: float) -> None:
    """Without a fault 42 units of 0.1 l flow out in 320 s: 2.9 l are left after 100 s."""
    one = rig(fault)
    one.actuate({"V8": True})
    one.advance(100 * S)
    assert one.sense()[sensor] == pytest.approx(reading)


def test_a_fault_ends_and_is_counted_while_it_lasts() -> None:
    one = rig(Injection(S, LEVEL, "lost", None, 2 * S), Injection(S, "B1", "leak", 0.1, 3 * S))
    counts = []
    for t_ns in (S - 1, S, 2 * S - 1, 2 * S, 3 * S):
        one.advance(t_ns)
        counts.append((one.observe()["faults"], one.sense()[LEVEL]))
    assert counts == [(0, 4.2), (2, 0.0), (2, 0.0), (1, 4.1), (0, 4.0)]


@settings(max_examples=25, deadline=None)
@given(stops=st.lists(st.integers(0, 60 * S), max_size=10), at_ns=st.integers(0, 60 * S))
def test_cuts_and_snapshots_change_nothing(stops: list[int], at_ns: int) -> None:
    def make() -> Rig:
        return rig(Injection(5 * S, LEVEL, "drift", 0.01, 20 * S),
                   Injection(9 * S, "V8", "slow", 3), Injection(30 * S, "B1", "leak", 0.02),
                   B1_level=Device(noise=0.1, delay_ns=S),
                   V8=Device(travel_ns=2 * S))
    whole, cut, kept = make(), make(), make()
    for one, instants in ((whole, [at_ns]), (cut, [*sorted(t for t in stops if t < at_ns), at_ns])):
        one.actuate({"V8": True})
        for t_ns in instants:
            one.advance(t_ns)
            one.next_event_ns()
    assert cut.sense() == whole.sense()
    kept.restore(json.loads(json.dumps(whole.snapshot())))
    for one in (whole, cut, kept):
        one.actuate({"V8": False})
        one.advance(70 * S)
    assert cut.sense() == whole.sense() == kept.sense()
    assert cut.report() == whole.report() == kept.report()


def test_a_snapshot_with_other_faults_is_refused() -> None:
    with pytest.raises(ValueError, match="with these faults"):
        rig().restore(rig(Injection(S, "V8", "stuck")).snapshot())


def test_reset_takes_faults_back() -> None:
    one = rig(Injection(S, "V8", "stuck"))
    fresh = one.snapshot()
    one.advance(5 * S)
    one.reset()
    assert one.snapshot() == fresh


def test_a_disturbance_is_a_fault_of_every_plant_that_declares_it() -> None:
    one = Rig(Evaporator(), {}, [Injection(S, "condenser", "malfunction", None, 2 * S)])
    assert readings(one, "Malf", [S - 1, S, 2 * S]) == [False, True, False]
