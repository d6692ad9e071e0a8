"""Parameters and the registry: what is accepted, and what is said about the rest."""

from __future__ import annotations

import math

import pytest

from plant_sim import ParameterError, Plant, PlantLoadError, load
from plant_sim.batch_plant import BatchParameters, BatchPlant
from plant_sim.batch_plant.loads import CONTENTS


def test_values_may_come_as_text() -> None:
    parameters = BatchParameters.of({"load": "2.5", "half": "water", "B3_B4_s": "601"})
    assert (parameters.load, parameters.half, parameters.B3_B4_s) == (2.5, "water", 601.0)


@pytest.mark.parametrize(
    ("name", "found", "expected"),
    [
        ("load", "2.3", "0 to 8 in steps of 0.5"),
        ("load", 8.5, "0 to 8 in steps of 0.5"),
        ("load", "many", "0 to 8 in steps of 0.5"),
        ("load", True, "0 to 8 in steps of 0.5"),
        ("half", "salt", "one of solution, water"),
        ("brim_l", -1, "a number at least 0 l and at most 10 l"),
        ("brim_l", "nan", "a number at least 0 l and at most 10 l"),
        ("heat_up_s", 1470, "less than heat_B5_s, 1470 s"),
        ("laod", 2, "a known parameter: did you mean load?"),
        ("tanks", "B8=empty", "a tank B1 to B7 where 'B8' stands"),
        ("tanks", {"B3": "sol84C"}, "B3 to be one of empty, sol42C, water28C, sol70C"),
        ("tanks", 3, "TANK=CONTENT,... or a mapping of tanks to contents"),
    ],
)
def test_a_bad_parameter_is_named_with_what_was_found_and_expected(
    name: str, found: object, expected: str
) -> None:
    with pytest.raises(ParameterError) as caught:
        BatchPlant({name: found})
    assert (caught.value.name, caught.value.expected) == (name, expected)
    assert repr(caught.value.found).strip("'") in (str(found), f"{found}.0", repr(found))


def test_the_table_of_parameters_can_be_listed_for_help() -> None:
    table = {row.name: row for row in BatchParameters.table()}
    assert table["B3_B4_s"].unit == "s"
    assert table["B3_B4_s"].default == 600.0
    assert table["load"].expected == "0 to 8 in steps of 0.5"
    assert all(row.description and row.expected for row in table.values())


def test_tanks_can_hold_the_8100_configurations_of_the_paper() -> None:
    assert math.prod(len(words) for words in CONTENTS.values()) == 8100


def test_both_spellings_of_two_units_of_solution_are_read() -> None:
    assert BatchParameters.of({"tanks": "B1=sol82C, B7=sol84H"}).tanks["B1"] == "sol84C"


def test_a_registered_name_loads_a_plant_that_keeps_the_contract() -> None:
    plant = load("batch_plant", {"load": "1"})
    assert isinstance(plant, Plant)
    assert plant.name == "batch_plant"


def test_a_dotted_path_loads_a_users_own_plant() -> None:
    assert load("plant_sim.batch_plant.plant:BatchPlant").t_ns == 0


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("batch_plan", "did you mean batch_plant?"),
        ("reactor", "known: batch_plant"),
        ("no.such.module:Plant", "cannot import no.such.module"),
        ("plant_sim.batch_plant:Evaporator", "has no class Evaporator"),
        ("collections:OrderedDict", "does not keep the plant contract"),
    ],
)
def test_what_is_no_plant_is_refused_with_the_reason(name: str, reason: str) -> None:
    with pytest.raises(PlantLoadError, match=reason.replace("?", r"\?")):
        load(name)
