"""Closed forms of the batch plant: durations, strengths, temperatures, conservation."""

from __future__ import annotations

from fractions import Fraction

import pytest
from batch_drives import PATHS, S, plant_with, replay, switch, volumes

from plant_sim.batch_plant import BatchPlant
from plant_sim.batch_plant.layout import ACTUATORS

TABLE_1 = [
    ("B1-B3", "B1=sol42C", 320),
    ("B2-B3", "B2=water28C", 240),
    ("B3-B4", "B3=sol70C", 600),
    ("B4-B5", "B4=sol70C", 330),
    ("B5-B7", "B5=sol42H", 260),
    ("B7-B1", "B7=sol42C", 220),
    ("B6-B2", "B6=water28C", 240),
]


@pytest.mark.parametrize(("name", "tanks", "duration_s"), TABLE_1)
def test_a_transfer_takes_exactly_the_seconds_of_table_1(
    name: str, tanks: str, duration_s: int
) -> None:
    plant = plant_with(tanks)
    source, sink = name.split("-")
    amount = plant.volume(source)
    switch(plant, *PATHS[name])
    plant.advance(duration_s * S - 1)
    assert plant.volume(source) > 0
    plant.advance(duration_s * S)
    assert (plant.volume(source), plant.volume(sink)) == (0, amount)


@pytest.mark.parametrize(
    ("name", "tanks", "duration_s"),
    [("B1-B3", "B1=sol84C", 320), ("B4-B5", "B4=sol140C", 330), ("B6-B2", "B6=water56C", 240)],
)
def test_the_level_sensor_shows_a_drained_unit_at_exactly_its_ns(
    name: str, tanks: str, duration_s: int
) -> None:
    plant = plant_with(tanks)
    source = name[:2]
    unit = plant.counts()[f"{source}.level"] // 2
    switch(plant, *PATHS[name])
    plant.advance(duration_s * S - 1)
    assert plant.counts()[f"{source}.level"] == unit + 1
    plant.advance(duration_s * S)
    assert plant.counts()[f"{source}.level"] == unit


def test_one_closed_valve_in_a_path_stops_the_flow() -> None:
    plant = plant_with("B7=sol42C")
    switch(plant, *PATHS["B7-B1"])
    switch(plant, "V22", on=False)
    plant.advance(100 * S)
    assert plant.sense()["B7.level"] == 4.2


def test_heating_reaches_100_degC_in_270_s_and_has_evaporated_a_unit_after_1470_s() -> None:
    plant = plant_with("B5=sol70C")
    switch(plant, "Heater")
    plant.advance(135 * S)
    assert plant.temperature_degC("B5") == 60
    plant.advance(270 * S)
    assert plant.temperature_degC("B5") == 100
    assert plant.sense()["B5.level"] == 7.0
    plant.advance(1470 * S)
    readings = plant.sense()
    assert (readings["B5.level"], readings["B5.concentration"]) == (4.2, 5.0)
    assert (readings["B6.level"], readings["B6.temperature"]) == (2.8, 100.0)
    assert readings["B6.concentration"] == 0.0


def test_boiling_goes_on_where_it_was_interrupted() -> None:
    plant = plant_with("B5=sol70C")
    switch(plant, "Heater")
    plant.advance(870 * S)
    switch(plant, "Heater", on=False)
    plant.advance(2000 * S)
    switch(plant, "Heater")
    plant.advance(2600 * S)
    assert plant.counts()["B5.level"] == 42


@pytest.mark.parametrize(
    ("tanks", "valve", "tank", "duration_s"),
    [
        ("B7=sol42H", "V17", "B7", 600),
        ("B7=sol84H", "V17", "B7", 600),
        ("B6=water28H", "V29", "B6", 300),
    ],
)
def test_cooling_reaches_20_degC_after_exactly_its_duration_and_stays(
    tanks: str, valve: str, tank: str, duration_s: int
) -> None:
    plant = plant_with(tanks)
    switch(plant, valve)
    plant.advance(duration_s * S // 2)
    assert plant.temperature_degC(tank) == 60
    plant.advance(duration_s * S - 1)
    assert plant.sense()[f"{tank}.temperature"] == 21.0
    plant.advance(duration_s * S)
    assert plant.sense()[f"{tank}.temperature"] == 20.0
    plant.advance(10 * duration_s * S)
    assert plant.temperature_degC(tank) == 20


def test_salt_and_heat_mix_by_volume() -> None:
    plant = plant_with("B3=sol42C,B2=water28C")
    switch(plant, "V9", "Mixer")
    plant.advance(240 * S)
    assert plant.concentration_g_l("B3") == 3
    plant = plant_with("B5=sol42H,B7=sol42C")
    switch(plant, "V15")
    plant.advance(260 * S)
    assert plant.temperature_degC("B7") == 60


def test_an_empty_tank_reads_no_level_cold_and_no_salt() -> None:
    readings = plant_with("B1=sol42C").sense()
    assert [readings[f"B4.{x}"] for x in ("level", "temperature", "concentration")] == [0, 20, 0]


def test_a_boiled_dry_tank_keeps_its_salt() -> None:
    plant = plant_with("B5=sol42H")
    salt = plant.salt("B5")
    switch(plant, "Heater")
    plant.advance(1799 * S)
    assert not plant.observe()["B5.dry_heating"]
    plant.advance(1800 * S)
    assert plant.observe()["B5.dry_heating"]
    assert (plant.volume("B5"), plant.salt("B5")) == (0, salt)
    assert plant.volume("B6") == plant.units.of_litres(Fraction("4.2"))


def test_no_drop_and_no_grain_is_lost_in_thirty_batches() -> None:
    plant = BatchPlant({"load": 5})
    volume = sum(volumes(plant))
    salt = sum(plant.salt(tank) for tank in plant.units.brims)
    replay(plant, 5, "solution", 30)
    assert sum(volumes(plant)) == volume
    assert sum(plant.salt(tank) for tank in plant.units.brims) == salt


def test_every_valve_open_at_once_still_conserves_volume_and_salt() -> None:
    plant = BatchPlant({"load": 6.5, "brim_l": 0.1})
    volume = sum(volumes(plant))
    grams = sum(plant.units.grams(plant.salt(t)) for t in [*plant.units.brims, "spill"])
    switch(plant, *ACTUATORS)
    plant.advance(1500 * S)
    after = sum(plant.units.grams(plant.salt(t)) for t in [*plant.units.brims, "spill"])
    assert sum(volumes(plant)) == volume
    assert after == pytest.approx(grams, abs=1e-12)


def test_leaks_lose_liquid_to_the_floor_and_nothing_else() -> None:
    plant = BatchPlant({"load": 6.5, "brim_l": 0.1})
    volume = sum(volumes(plant))
    switch(plant, *ACTUATORS)
    plant.disturb({"B1.leak": 0.01, "B4.leak": 0.03, "B5.leak": 0.02, "Pump1.worn": 0.3})
    plant.advance(1500 * S)
    assert sum(volumes(plant)) == volume
    assert plant.report()["spilled_l"] > 5


def test_a_worn_pump_takes_longer_by_its_wear_and_a_failed_heater_for_ever() -> None:
    plant = plant_with("B7=sol42C")
    switch(plant, *PATHS["B7-B1"])
    plant.disturb({"Pump1.worn": 0.2})
    plant.advance(220 * S * 10 // 8 - 1)
    assert plant.volume("B7") > 0
    plant.advance(220 * S * 10 // 8 + 1)
    assert plant.volume("B7") == 0
    heated = plant_with("B5=sol70C")
    switch(heated, "Heater")
    heated.disturb({"Heater.failed": True})
    heated.advance(5000 * S)
    assert heated.temperature_degC("B5") == 20
