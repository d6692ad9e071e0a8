"""The heating tank's five controllers, beside the paper's text and tables."""

import pytest
from controller import Controller
from paper_tables import TABLE_3, TABLE_4, TABLE_5, states
from systems import ROOT

from plcemu.lang.compile import compile_program
from plcemu.lang.sipn_il import export_il

FOLDER = ROOT / "il_programs/heating_tank"
INPUTS = ("i1", "i2", "i3", "i4", "i5")
PLACES = {1: 5, 2: 6, 3: 6, 4: 7, 5: 7}
TRANSITIONS = {1: 5, 2: 9, 3: 10, 4: 10, 5: 10}


def path_of(version):
    return FOLDER / f"version{version}.sipn"


def names_of(version):
    return [*(f"P{n + 1}" for n in range(PLACES[version])),
            *(f"T{n + 1}" for n in range(TRANSITIONS[version])), "eoc"]


def replay(program, version, table):
    """Give a table's inputs, one column a scan; return what the program shows of its other rows."""
    controller, shown = Controller(program), []
    for state in states(table):
        for name in INPUTS:
            controller[name] = state.get(name, False)
        controller.scan()
        shown.append({name: controller[name] for name in names_of(version)})
    return controller, shown


def expected_of(version, table):
    return [{name: state.get(name, False) for name in names_of(version)}
            for state in states(table)]


@pytest.mark.parametrize(("version", "table"), [(2, TABLE_3), (3, TABLE_4), (4, TABLE_5)])
@pytest.mark.parametrize("exported", [False, True])
def test_a_counterexample_of_the_paper_replays_state_by_state(version, table, exported):
    path = path_of(version)
    program = compile_program(export_il(path, single_firing=True)) if exported \
        else compile_program(path, single_firing=True)
    assert replay(program, version, table)[1] == expected_of(version, table)


def test_in_version_2_the_motor_turns_after_the_stop_button_table_3():
    controller, _ = replay(compile_program(path_of(2), single_firing=True), 2, TABLE_3)
    assert [controller[f"o{n}"] for n in (1, 2, 3, 4)] == [False, False, True, False]


def test_in_version_3_the_net_tells_of_the_conflict_of_T6_and_T10_table_4():
    controller, _ = replay(compile_program(path_of(3), single_firing=True), 3, TABLE_4)
    assert controller["conflict"] is True


@pytest.mark.parametrize("version", [2, 4, 5])
def test_the_same_inputs_make_no_conflict_in_other_versions(version):
    controller, _ = replay(compile_program(path_of(version), single_firing=True), version, TABLE_4)
    assert controller["conflict"] is False


def every_input():
    return [{name: bool(n >> bit & 1) for bit, name in enumerate(INPUTS)} for n in range(32)]


def successors(controller, version, marking):
    """Return the stable markings that one scan leads to from a stable one, whatever the inputs."""
    places = [f"P{n + 1}" for n in range(PLACES[version])]
    found = set()
    for inputs in every_input():
        for name, value in {**{p: p in marking for p in places}, **inputs}.items():
            controller[name] = value
        controller.scan()
        found.add(frozenset(p for p in places if controller[p]))
    return found


def markings_from(version, marking):
    """Return all stable markings that lie ahead of one."""
    controller, found, pending = Controller(compile_program(path_of(version))), set(), [marking]
    while pending:
        new = successors(controller, version, pending.pop()) - found
        found |= new
        pending += new
    return found


def test_in_version_4_nothing_moves_the_net_any_more_after_table_5():
    assert markings_from(4, frozenset({"P6"})) == {frozenset({"P6"})}


@pytest.mark.parametrize("version", [2, 5])
def test_in_a_sound_version_every_stable_marking_leads_back_to_the_initial_one(version):
    initial = frozenset({"P1"})
    assert all(initial in markings_from(version, each) for each in markings_from(version, initial))


WARNINGS = {1: set(), 2: set(), 3: {"P0114", "P0115", "P0116", "P0117"}, 4: {"P0115", "P0116"},
            5: set()}
"""What is formally wrong in the paper: nothing in 1, 2 and 5, a conflict in 3, a deadlock in 4."""


@pytest.mark.parametrize("version", WARNINGS)
def test_the_compiler_warns_of_just_the_formal_errors_of_the_paper(version):
    assert {d.code for d in compile_program(path_of(version)).warnings} == WARNINGS[version]


def test_the_conflict_that_the_compiler_finds_is_the_paper_s():
    found = [str(d) for d in compile_program(path_of(3)).warnings]
    assert any("T10 may be in conflict with T6 when marked are P2, P3" in each for each in found)


def test_the_deadlock_that_the_compiler_finds_is_the_paper_s():
    found = [str(d) for d in compile_program(path_of(4)).warnings]
    assert any("no transition leads on when marked are P6" in each for each in found)
