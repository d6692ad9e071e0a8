"""The heating tank's five controllers proved with free inputs, beside the paper's verdicts."""

from __future__ import annotations

import pytest
from paper_tables import TABLE_3, TABLE_4, TABLE_5, states
from systems import ROOT

from plcemu.monitor import Suite, parse_properties
from plcemu.runtime.config import load_config
from plcemu.runtime.verification import make_prover
from plcemu.verify.explore import explore
from plcemu.verify.path import Path
from plcemu.verify.prove import Proof

FOLDER = ROOT / "il_programs/heating_tank"


def proved(version: int, *overrides: str) -> dict[str, Proof]:
    config = load_config(FOLDER, [f"program=version{version}.sipn", *overrides])
    return {p.name: p for p in make_prover(config).prove().proofs}


def violated(version: int) -> set[str]:
    verdicts = {name: p.finding.verdict for name, p in proved(version).items()}
    assert set(verdicts.values()) <= {"holds", "violated"}
    return {name for name, verdict in verdicts.items() if verdict == "violated"}


PAPER = {1: set(), 2: {"property_3"}, 5: set(),
         3: {"no_conflict", "outputs_defined"},
         4: {"deadlock_free", "reversible", "live", "live_each", "outputs_defined", "property_1"}}
"""What each version lacks. The paper names property 3, the conflict and the deadlock; it stops at
the first formal error, so the other violations of versions 3 and 4 are not in it."""


@pytest.mark.parametrize("version", PAPER)
def test_the_verdicts_on_all_five_versions_are_those_of_the_paper(version: int) -> None:
    assert violated(version) == PAPER[version]


@pytest.mark.parametrize("version", PAPER)
def test_property_2_as_printed_is_vacuous_in_every_version(version: int) -> None:
    found = proved(version)["property_2"].finding
    assert found.verdict == "holds"
    assert found.vacuous_in == ("P1 & !TANK.i1 & !TANK.i2 & TANK.i4 & eoc is never true",)


def test_what_property_2_intends_fails_when_start_and_stop_are_pressed_together() -> None:
    path = proved(5, "verify.properties=intended.prop")["property_2_intended"].path
    assert path is not None
    pressed = [row.changes for row in path.rows if row.changes.get("TANK.T1")]
    assert [(c["TANK.i4"], c["TANK.i5"]) for c in pressed] == [(True, True)]
    assert shown(path)[-1].items() >= {"P6": True, "eoc": True}.items()
    assert len(path.rows) == 4


def test_what_property_2_intends_holds_where_there_is_no_stop_button() -> None:
    found = proved(1, "verify.properties=intended.prop")["property_2_intended"].finding
    assert (found.verdict, found.vacuous_in) == ("holds", ())


def test_version_1_without_a_stop_button_has_property_3_only_vacuously() -> None:
    assert proved(1)["property_3"].finding.vacuous_in == ("plant.i5 & eoc is never true",)


def shown(path: Path) -> list[dict[str, bool]]:
    """The whole states of a counterexample, without the program's name; only BOOL tags."""
    names = [tag.name.removeprefix("TANK.") for tag in path.predicates.tags]
    return [{n: bool(v) for n, v in zip(names, row.values, strict=True)} for row in path.rows]


@pytest.mark.parametrize(("version", "name", "table", "free"), [
    (2, "property_3", TABLE_3, 1), (3, "no_conflict", TABLE_4, 0),
    (4, "deadlock_free", TABLE_5, 0)])
def test_the_counterexample_is_the_table_of_the_paper(version: int, name: str, table: str,
                                                      free: int) -> None:
    """State by state; in the last `free` states the inputs, which there do not matter, differ."""
    path = proved(version)[name].path
    assert path is not None
    expected = states(table)
    assert len(path.rows) == len(expected)
    for n, (found, printed) in enumerate(zip(shown(path), expected, strict=True)):
        told = set(printed) - ({"i4", "i5"} if n >= len(expected) - free else set())
        rows = {*told, *(f"P{k}" for k in range(1, 8)), *(f"T{k}" for k in range(1, 11)), "eoc"}
        assert {k: found[k] for k in rows & set(found)} == \
            {k: printed.get(k, False) for k in rows & set(found)}


def test_the_deadlock_is_told_as_what_no_run_reaches_any_more() -> None:
    assert proved(4)["deadlock_free"].finding.remark == "from here on no run reaches !eoc"


@pytest.mark.parametrize(("version", "name", "linear"), [
    (3, "no_conflict", "G !conflict"), (4, "property_1", "G ((o1 | o2 | o4) -> o3)")])
def test_in_the_counterexample_the_online_monitor_violates_at_the_last_instant(
        version: int, name: str, linear: str) -> None:
    path = proved(version)[name].path
    assert path is not None
    trace = path.trace()
    suite = Suite(parse_properties(f"it: {linear}"), trace.tags)
    for frame in trace.frames:
        suite.observe(frame)
    result, = suite.finish(trace.end_ns)
    assert result.failed and result.decided_at_ns == trace.end_ns


def test_inputs_stand_still_while_the_net_can_fire() -> None:
    prover = make_prover(load_config(FOLDER))
    prover.prove()
    unstable = prover.predicates.test(parse_properties("it: !eoc")[0].formula)
    graph = explore(prover.loop)
    moving = [n for n, s in enumerate(graph.states) if unstable(s.memory, s.plant.values)]
    assert moving and all(len(graph.targets(n)) == 1 for n in moving)


def test_that_parts_are_live_as_printed_says_no_more_than_that_one_of_them_is() -> None:
    assert any("EF T5" in part for part in proved(1)["live"].finding.vacuous_in)
    assert proved(1)["live_each"].finding.vacuous_in == ()
