"""Time in the batch plant: partitions, events, snapshots and forks never change a result."""

from __future__ import annotations

import json

import pytest
from batch_drives import S, commands, plant_with, replay, switch
from hypothesis import given, settings
from hypothesis import strategies as st

from plant_sim.batch_plant import BatchPlant
from plant_sim.batch_plant.layout import ACTUATORS

SINGLE = ("V8", "V9", "V11", "V12", "V15", "V17", "V29", "Mixer", "Heater")
PATHS: list[tuple[str, ...]] = [(name,) for name in SINGLE]
PATHS += [("V18", "V23", "V22", "V1", "V3", "Pump1"), ("V20", "V24", "V25", "V5", "V6", "Pump2")]
COMMAND = st.tuples(st.integers(0, 900 * S), st.sampled_from(PATHS), st.booleans())
COMMANDS = st.lists(COMMAND, min_size=1, max_size=8).map(sorted)
INSTANTS = st.lists(st.integers(0, 2000 * S), max_size=12)
LOADS = st.sampled_from([2, 4.5, 6.5, 8])
Commands = list[tuple[int, tuple[str, ...], bool]]


def run(plant: BatchPlant, script: Commands, stops: list[int]) -> None:
    """Carry out a script and also stop, look and ask at some instants before its end."""
    end_ns = 2000 * S
    steps = [(t_ns, path, on) for t_ns, path, on in script] + [(t, (), True) for t in stops]
    for t_ns, path, on in sorted(steps, key=lambda step: step[0]):
        plant.advance(t_ns)
        plant.sense()
        plant.next_event_ns()
        plant.actuate(dict.fromkeys(path, on))
    plant.advance(end_ns)


def events(plant: BatchPlant, limit: int) -> list[tuple[int, object, object]]:
    """The next events with what is read and known at each."""
    seen: list[tuple[int, object, object]] = []
    while len(seen) < limit and (t_ns := plant.next_event_ns()) is not None:
        plant.advance(t_ns)
        seen.append((t_ns, plant.counts(), plant.observe()))
    return seen


@settings(max_examples=60, deadline=None)
@given(load=LOADS, script=COMMANDS, stops=INSTANTS)
def test_how_time_is_cut_changes_nothing(load: float, script: Commands, stops: list[int]) -> None:
    whole, cut = BatchPlant({"load": load}), BatchPlant({"load": load})
    run(whole, script, [])
    run(cut, script, stops)
    assert cut.snapshot() == whole.snapshot()
    assert cut.sense() == whole.sense()
    assert events(cut, 10) == events(whole, 10)


@settings(max_examples=40, deadline=None)
@given(
    load=LOADS,
    paths=st.lists(st.sampled_from(PATHS), min_size=1, max_size=4, unique=True),
    watched=st.lists(st.sampled_from(["B3.level", "B5.temperature", "B7.concentration"])),
    fraction=st.floats(0, 1),
)
def test_nothing_shows_before_the_next_event_and_something_at_it(
    load: float, paths: list[tuple[str, ...]], watched: list[str], fraction: float
) -> None:
    plant = BatchPlant({"load": load})
    plant.watch(watched)
    for path in paths:
        switch(plant, *path)
    for _ in range(12):
        before = (plant.counts(), plant.observe())
        t_ns, event_ns = plant.t_ns, plant.next_event_ns()
        end_ns = t_ns + 5000 * S if event_ns is None else event_ns - 1
        plant.advance(t_ns + int((end_ns - t_ns) * fraction))
        assert (plant.counts(), plant.observe()) == before
        assert plant.next_event_ns() == event_ns
        plant.advance(end_ns)
        assert (plant.counts(), plant.observe()) == before
        plant.advance(end_ns + 1)
        assert event_ns is None or (plant.counts(), plant.observe()) != before


@settings(max_examples=30, deadline=None)
@given(load=LOADS, script=COMMANDS, later=COMMANDS)
def test_a_restored_snapshot_continues_bit_identically(
    load: float, script: Commands, later: Commands
) -> None:
    plant, twin = BatchPlant({"load": load}), BatchPlant({"load": load})
    run(plant, script, [])
    twin.restore(json.loads(json.dumps(plant.snapshot())))
    assert twin.snapshot() == plant.snapshot()
    for t_ns, path, on in later:
        for one in (plant, twin):
            one.advance(2000 * S + t_ns)
            one.actuate(dict.fromkeys(path, on))
    assert events(twin, 5) == events(plant, 5)
    assert twin.snapshot() == plant.snapshot()


def test_a_look_ahead_leaves_no_trace() -> None:
    plant = plant_with("B5=sol70C")
    plant.watch(["B6.level"])
    switch(plant, "Heater")
    before = plant.snapshot()
    assert plant.next_event_ns() == 270 * S + 1
    assert plant.snapshot() == before


def test_reset_starts_again_from_the_beginning() -> None:
    plant = BatchPlant({"load": 3})
    fresh = plant.snapshot()
    replay(plant, 3, "solution", batches=3)
    plant.reset()
    assert plant.snapshot() == fresh


def test_a_plant_that_circulates_unseen_for_ever_still_names_an_instant(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(BatchPlant, "look_ahead_limit", 50)
    plant = BatchPlant({"load": 2})
    switch(plant, *ACTUATORS)
    plant.watch([])
    plant.advance(1000 * S)
    event_ns = plant.next_event_ns()
    assert event_ns is not None
    assert event_ns > plant.t_ns


def test_a_plant_at_rest_has_no_next_event() -> None:
    assert BatchPlant({"load": 8}).next_event_ns() is None


def test_only_watched_sensors_are_read_and_cause_events() -> None:
    plant = plant_with("B1=sol42C")
    plant.watch(["B1.level"])
    switch(plant, "V8")
    assert plant.next_event_ns() == -(-320 * S // 42)
    assert list(plant.sense()) == ["B1.level"]
    plant.watch(["B3.concentration"])
    assert plant.next_event_ns() == 1
    plant.watch([])
    assert plant.next_event_ns() is None
    assert plant.sense() == {}
    plant.watch()
    assert len(plant.sense()) == 21


def test_counts_and_readings_say_the_same_within_no_error() -> None:
    plant = BatchPlant({"load": 5})
    for t_ns, values in commands(5, "solution", batches=3):
        plant.advance(t_ns)
        plant.actuate(values)
        readings, counts = plant.sense(), plant.counts()
        assert all(
            round(readings[port.name] / port.resolution) == counts[port.name]
            for port in plant.ports
            if port.direction == "sensor"
        )


def test_going_back_in_time_is_refused() -> None:
    plant = BatchPlant()
    plant.advance(10)
    with pytest.raises(ValueError, match="cannot go back to 9 ns"):
        plant.advance(9)


def test_names_that_do_not_exist_are_refused() -> None:
    plant = BatchPlant()
    with pytest.raises(ValueError, match="no actuator V2"):
        plant.actuate({"V2": True})
    with pytest.raises(ValueError, match=r"no sensor B8\.level"):
        plant.watch(["B8.level"])


def test_a_snapshot_of_another_plant_is_refused() -> None:
    with pytest.raises(ValueError, match="not of this"):
        BatchPlant({"load": 1}).restore(BatchPlant({"load": 2}).snapshot())


def test_every_actuator_of_figure_4_is_a_port() -> None:
    names = {port.name for port in BatchPlant().ports if port.direction == "actuator"}
    valves = {f"V{n}" for n in (1, 3, 5, 6, 8, 9, 11, 12, 15, 17, 18, 20, 22, 23, 24, 25, 29)}
    assert names == set(ACTUATORS) == valves | {"Mixer", "Heater", "Pump1", "Pump2"}
