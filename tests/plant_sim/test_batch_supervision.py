"""What is noted of a batch plant: loads, batches, overflow, wrong mixtures, pumps, the report."""

from __future__ import annotations

import pytest
from batch_drives import PATHS, S, plant_with, replay, switch
from paper_oracle import simulate

from plant_sim.batch_plant import BatchPlant
from plant_sim.batch_plant.layout import CONCENTRATION_G_L
from plant_sim.batch_plant.summary import period_s

FULL = "B1=sol84C B2=water56C B3=sol70C B4=sol140C B5=sol70C"
LOADS = [
    (0, "solution", ""),
    (0.5, "solution", "B1=sol42C"),
    (0.5, "water", "B2=water28C"),
    (1, "solution", "B1=sol42C B2=water28C"),
    (1.5, "solution", "B1=sol84C B2=water28C"),
    (1.5, "water", "B1=sol42C B2=water56C"),
    (2, "solution", "B1=sol84C B2=water56C"),
    (2.5, "solution", "B1=sol84C B2=water56C B3=sol42C"),
    (2.5, "water", "B1=sol84C B2=water56C B3=water28C"),
    (3, "solution", "B1=sol84C B2=water56C B3=sol70C"),
    (3.5, "solution", "B1=sol84C B2=water56C B3=sol70C B7=sol42C"),
    (3.5, "water", "B1=sol84C B2=water56C B3=sol70C B6=water28C"),
    (4, "solution", "B1=sol84C B2=water56C B3=sol70C B4=sol70C"),
    (5, "solution", "B1=sol84C B2=water56C B3=sol70C B4=sol140C"),
    (6, "solution", FULL),
    (6.5, "water", f"{FULL} B6=water28C"),
    (7, "solution", f"{FULL} B6=water28C B7=sol42C"),
    (7.5, "solution", f"{FULL} B6=water28C B7=sol84C"),
    (7.5, "water", f"{FULL} B6=water56C B7=sol42C"),
    (8, "solution", f"{FULL} B6=water56C B7=sol84C"),
]


@pytest.mark.parametrize(("load", "half", "tanks"), LOADS)
def test_a_load_fills_the_tanks_from_the_top(load: float, half: str, tanks: str) -> None:
    plant = BatchPlant({"load": load, "half": half})
    assert plant.initial_tanks() == dict(pair.split("=") for pair in tanks.split())
    salt_g = sum(plant.units.grams(plant.salt(tank)) for tank in plant.units.brims)
    solution = int(load) + (load != int(load) and half == "solution")
    assert salt_g == pytest.approx(solution * 4.2 * float(CONCENTRATION_G_L["solution"]))


@pytest.mark.parametrize(
    ("load", "half"), [(1, "solution"), (2.5, "water"), (5, "solution"), (7, "solution")]
)
def test_the_paper_s_schedule_runs_cleanly_and_is_recognised(load: float, half: str) -> None:
    plant = BatchPlant({"load": load, "half": half})
    oracle = simulate(plant.initial_tanks(), batches=30)
    replay(plant, load, half, batches=30)
    assert sorted(plant.log) == sorted((t_s * S, f"P{process}") for t_s, process in oracle.starts)
    report = plant.report()
    assert (report["batches"], report["period_s"]) == (30, oracle.period_s)
    assert report["first_batch_s"] == oracle.batches_s[0]
    assert report["last_batch_s"] == plant.observe()["last_batch_s"] == oracle.batches_s[-1]
    assert report["produces"]
    assert not any(value is True for value in plant.observe().values())


def test_a_batch_is_counted_when_its_transfer_starts_and_not_when_it_resumes() -> None:
    plant = plant_with("B3=sol70C")
    assert plant.observe()["first_batch_s"] == -1.0
    plant.advance(5 * S)
    switch(plant, "V11")
    plant.advance(6 * S)
    switch(plant, "V11", on=False)
    switch(plant, "V11")
    assert plant.observe()["batches"] == 1
    assert plant.observe()["first_batch_s"] == 5.0


def test_what_is_no_mixed_batch_is_not_counted() -> None:
    plant = plant_with("B3=sol42C")
    switch(plant, "V11")
    assert plant.observe()["batches"] == 0
    assert plant.observe()["forbidden_mixture"]


def test_a_tank_runs_over_when_its_brim_is_reached_and_what_is_over_is_lost() -> None:
    plant = plant_with("B1=sol84C,B7=sol42C", brim_l=1.4)
    switch(plant, *PATHS["B7-B1"])
    plant.advance(220 * S // 3)
    assert not plant.observe()["overflow"]
    plant.advance(220 * S // 3 + 1)
    assert plant.observe()["overflow"] and plant.observe()["B1.overflow"]
    plant.advance(300 * S)
    assert plant.report()["tanks"]["B1"]["level_l"] == 9.8
    assert plant.report()["spilled_l"] == 2.8
    assert plant.report()["spilled_salt_g"] == 14.0


def test_a_tank_filled_exactly_to_its_brim_does_not_run_over() -> None:
    plant = plant_with("B1=sol42C,B7=sol42C", brim_l=0)
    switch(plant, *PATHS["B7-B1"])
    plant.advance(300 * S)
    assert plant.sense()["B1.level"] == 8.4
    assert not plant.observe()["overflow"]


def test_steam_runs_over_too() -> None:
    plant = plant_with("B5=sol70C,B6=water56C", brim_l=0)
    switch(plant, "Heater")
    plant.advance(1470 * S)
    assert plant.observe()["B6.overflow"]
    assert plant.report()["spilled_l"] == 2.8


@pytest.mark.parametrize(
    ("tanks", "actuators", "what"),
    [
        ("B1=sol42C,B3=water28C", ("V8",), "B1-B3 adds a second component to B3 without"),
        ("B2=water28C,B3=sol42C", ("V9",), "B2-B3 adds a second component to B3 without"),
        ("B1=sol42C,B2=water28C", ("V8", "V9"), "B1-B3 adds a second component"),
        ("B3=water28C", ("V11",), "B3-B4 carries 0.00 g/l instead of 3 g/l"),
        ("B5=sol70C", ("V15",), "B5-B7 carries 3.00 g/l instead of 5 g/l"),
    ],
)
def test_a_forbidden_mixture_is_noted_with_its_cause(
    tanks: str, actuators: tuple[str, ...], what: str
) -> None:
    plant = plant_with(tanks)
    switch(plant, *actuators)
    switch(plant, *actuators, on=False)
    assert plant.observe()["forbidden_mixture"]
    assert what in plant.report()["forbidden_mixture"]


def test_stopping_the_mixer_while_the_second_component_flows_is_forbidden() -> None:
    plant = plant_with("B1=sol42C,B3=water28C")
    switch(plant, "V8", "Mixer")
    plant.advance(100 * S)
    assert not plant.observe()["forbidden_mixture"]
    switch(plant, "Mixer", on=False)
    assert plant.observe()["forbidden_mixture"]


def test_heating_an_empty_evaporator_is_noted() -> None:
    plant = plant_with("B1=sol42C")
    switch(plant, "Heater")
    assert plant.observe()["B5.dry_heating"]


def test_a_pump_is_dry_or_blocked_only_after_its_grace() -> None:
    plant = plant_with("B7=sol42C")
    switch(plant, *PATHS["B7-B1"])
    plant.advance(221 * S - 1)
    assert not plant.observe()["Pump1.dry"]
    plant.advance(221 * S)
    assert plant.observe()["Pump1.dry"] and not plant.observe()["Pump1.blocked"]
    switch(plant, "Pump2")
    assert plant.next_event_ns() == 222 * S
    plant.advance(222 * S)
    assert plant.observe()["Pump2.blocked"]


def test_the_log_of_starts_is_bounded_and_counts_what_it_drops(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(BatchPlant, "log_limit", 3)
    plant = plant_with("B1=sol84C")
    for second in range(5):
        plant.advance(second * S)
        switch(plant, "V8")
        switch(plant, "V8", on=False)
    assert plant.log == [(0, "P1"), (S, "P1"), (2 * S, "P1")]
    assert plant.report()["process_starts_dropped"] == 2


@pytest.mark.parametrize(
    ("load", "reason"),
    [
        (0, "do not make one batch"),
        (0.5, "1 units of solution and 0 of water"),
        (8, "too little room"),
    ],
)
def test_a_plant_that_makes_nothing_says_why(load: float, reason: str) -> None:
    plant = BatchPlant({"load": load})
    plant.advance(10000 * S)
    report = plant.report()
    assert not report["produces"]
    assert reason in report["reason"]
    assert report["period_s"] is None


def test_a_plant_that_stands_still_after_some_batches_does_not_produce() -> None:
    plant = plant_with("B3=sol70C")
    switch(plant, "V11")
    plant.advance(600 * S)
    assert plant.report()["produces"]
    plant.advance(6000 * S)
    assert "nothing has moved since 600 s" in plant.report()["reason"]


@pytest.mark.parametrize(
    ("gaps", "period"),
    [
        ([], None),
        ([5], None),
        ([100, 100], 100),
        ([1160, 2640, 2060, 2060, 2060, 2060], 2060),
        ([9, 9, 7000, 1000, 3000, 1000, 3000, 1000, 3000], 2000),
        ([1000, 1000, 4000, 1000, 1000, 4000, 1000, 1000], 2000),
        ([2060.4, 2061.1, 2060.2, 2060.3], 2060.25),
        ([10, 200, 3000, 5000], 4000),
    ],
)
def test_the_period_is_that_of_the_pattern_the_times_settle_into(
    gaps: list[float], period: float | None
) -> None:
    starts = [round(sum(gaps[:n]) * S) for n in range(len(gaps) + 1)]
    assert period_s(starts) == pytest.approx(period)
