"""Sweeps: what is varied, which runs follow, and that chance depends on the seed alone."""

import csv

import pytest
from hypothesis import given
from hypothesis import strategies as st
from systems import ROOT, write_config

from plcemu.base.errors import ConfigError, PlcemuError
from plcemu.cli.main import main
from plcemu.runtime.config import ConfigText
from plcemu.runtime.sweep import Design, Measure, make_plan, packed
from plcemu.runtime.sweep_table import summarise
from plcemu.runtime.variation import VariationError, parse_variation
from plcemu.runtime.workers import run_here, run_on_cores

CONVEYOR = ROOT / "il_programs/conveyor"
MS = 1_000_000

# ---------------------------------------------------------------- what is varied


@pytest.mark.parametrize(("text", "values"), [
    ("load=1,2, 3", ("1", "2", "3")), ("x=5", ("5",)), ("program=a.sipn,b.sipn",
                                                         ("a.sipn", "b.sipn")),
    ("cycle=5ms..6ms:250us", ("5ms", "5.25ms", "5.5ms", "5.75ms", "6ms")),
    ("cycle=999us..1001us:1us", ("999us", "1ms", "1.001ms")),
    ("v=0.1..0.5:0.2", ("0.1", "0.3", "0.5")), ("v=1..2:0.75", ("1", "1.75")),
    ("v=-10..10:10", ("-10", "0", "10")), ("jitter=0.5%..1%:0.5%", ("0.5%", "1%")),
    ("v=3..3:1", ("3",)), ("v=1e3..2e3:5e2", ("1000", "1500", "2000")),
])
def test_lists_and_grids_have_the_values_that_they_say(text, values):
    assert parse_variation(text).values == values


@pytest.mark.parametrize(("text", "found"), [
    ("load", "no name and values"), ("=3", "no name and values"), ("load=", "no name and values"),
    ("load=1,,2", "an empty value"), ("v=1..", "where a number was expected"),
    ("v=a..b", "'a' where a number"), ("v=5ms..6:1", "units ns and none"),
    ("v=9..5:1", "first value above the last"), ("v=1..5:0", "the step '0'"),
    ("v=1..5:-1", "the step '-1'"), ("v=1ms..5ms:1", "the step '1'"),
    ("v=0..1:1e-9", "more than 1000000"), ("v=1..5:x", "'x' where a number"),
])
def test_a_malformed_variation_is_refused_with_what_was_found(text, found):
    with pytest.raises(VariationError, match=found):
        parse_variation(text)


@given(st.integers(0, 2**62), st.integers(0, 1000))
def test_a_range_draws_values_within_its_ends_and_the_same_for_the_same_seed(seed, run):
    variation = parse_variation("v=195..205")
    drawn = variation.draw(seed, run)
    assert 195 <= float(drawn) <= 205
    assert drawn == variation.draw(seed, run)


def test_a_range_of_durations_draws_durations():
    variation = parse_variation("cycle=10.945ms..11.055ms")
    drawn = {variation.draw(1, run) for run in range(50)}
    assert len(drawn) == 50
    assert all(10.945 <= float(each.removesuffix("ms")) <= 11.055 for each in drawn)


# ---------------------------------------------------------------- which runs


def parameters(design):
    return [dict(run.parameters) for run in design]


def test_lists_and_grids_are_combined_in_their_order():
    design = Design((parse_variation("a=1,2"), parse_variation("b=x,y")))
    assert parameters(design) == [{"a": "1", "b": "x"}, {"a": "1", "b": "y"},
                                  {"a": "2", "b": "x"}, {"a": "2", "b": "y"}]
    assert design.total == 4


def test_a_grid_without_chance_keeps_the_configured_seed():
    assert all("seed" not in run.parameters for run in Design((parse_variation("a=1,2"),)))


def test_several_runs_of_a_combination_have_different_seeds():
    seeds = [run.parameters["seed"] for run in Design((parse_variation("a=1,2"),), runs=50)]
    assert len(set(seeds)) == 100


def test_a_further_combination_changes_no_other_run():
    few = parameters(Design((parse_variation("a=1,2"),), 3, 7))
    many = parameters(Design((parse_variation("a=1,2,3"),), 3, 7))
    assert many[:6] == few


def test_another_seed_gives_other_runs():
    assert parameters(Design((), 3, 1)) != parameters(Design((), 3, 2))


# ---------------------------------------------------------------- results


def plan_of(design, collect=("plant.stop_mm",), overrides=()):
    return make_plan(ConfigText.read(CONVEYOR), overrides, 600 * MS, design, collect)


def results_of(generator):
    found = [each for chunk in generator for each in chunk]
    return sorted(found, key=lambda r: r.run.number)


def test_processes_give_the_same_results_as_one_after_the_other():
    design = Design((parse_variation("cycle=9ms,11ms"), parse_variation("speed_mm_s=199..201")), 4)
    plan = plan_of(design)
    assert results_of(run_on_cores(plan, design, 2)) == results_of(run_here(plan, design))


def test_a_run_is_what_simulate_gives_with_its_parameters(capsys):
    design = Design((parse_variation("speed_mm_s=199..201"),), 2, 3)
    plan = plan_of(design)
    last = results_of(run_here(plan, design))[-1]
    sets = [part for each in last.run.overrides for part in ("--set", each)]
    main(["simulate", str(CONVEYOR), "--until", "600ms", "--json", *sets])
    assert f'"stop_mm": {last.values["plant.stop_mm"]}' in capsys.readouterr().out


def test_without_collect_all_facts_of_the_plant_are_collected():
    plan = plan_of(Design(()), ())
    assert [m.label for m in plan.measures] == ["plant.stop_mm", "plant.stops",
                                                "plant.speed_mm_s", "plant.collision"]


def test_the_least_and_the_greatest_value_of_a_tag_are_collected():
    design = Design(())
    plan = plan_of(design, ("min(go_to_test)", "max(CONVEYOR.go_to_test)", "cycles", "max(cycles)"))
    assert results_of(run_here(plan, design))[0].values == {
        "min(go_to_test)": False, "max(CONVEYOR.go_to_test)": True, "cycles": 1, "max(cycles)": 1}


def test_a_measure_is_read_from_its_text():
    assert Measure.parse(" MAX( a.b ) ") == Measure("MAX( a.b )", "a.b", "max")


def test_a_value_that_does_not_fit_is_refused_before_any_run():
    with pytest.raises(ConfigError, match=r"--set cycle=abc: cycle: found 'abc', expected"):
        plan_of(Design((parse_variation("cycle=11ms,abc"),)))


def test_a_range_that_reaches_beyond_a_parameter_s_bounds_is_refused_before_any_run():
    with pytest.raises(ConfigError, match=r"perturbation_pct: found '?100.*expected"):
        plan_of(Design((parse_variation("perturbation_pct=0..100"),)))


def test_a_tag_that_does_not_exist_is_refused_with_a_hint():
    with pytest.raises(PlcemuError, match=r"--collect plant.stop_m: .*did you mean"):
        plan_of(Design(()), ("plant.stop_m",))


def test_a_summary_tells_the_extremes_and_the_violations_of_each_combination():
    design = Design((parse_variation("test_mm=79.9,80"),), 3)
    plan = plan_of(design)
    first, second = summarise(plan, results_of(run_here(plan, design)))
    assert (first.point, first.runs, second.violated) == (("79.9",), 3, {})
    low, mean, high = second.numbers["plant.stop_mm"]
    assert low <= mean <= high


DIVIDER = """PROGRAM MAIN
VAR n AT %QW0 : INT; divisor AT %IW0 : INT; END_VAR
n := 100 / divisor;
END_PROGRAM
"""


def test_a_program_that_faults_in_a_run_is_told_and_fails_the_command(tmp_path, capsys):
    path = write_config(tmp_path, "program: main.il\nsweep: {until: 1s, collect: n}\n", DIVIDER)
    assert main(["sweep", str(path), "--vary", "cycle=10ms,20ms", "--workers", "1"]) == 1
    assert "in 2 of 2 runs, first with --set cycle=10ms" in capsys.readouterr().out


# ---------------------------------------------------------------- the command


def test_the_command_writes_rows_and_a_plot(tmp_path, capsys):
    rows, plot = tmp_path / "rows.csv", tmp_path / "plot.svg"
    code = main(["sweep", str(CONVEYOR), "--vary", "cycle=9ms..11ms:1ms", "--runs", "2",
                 "--workers", "1", "--csv", str(rows), "--plot", str(plot)])
    assert code == 0
    with rows.open(newline="") as file:
        table = list(csv.DictReader(file))
    assert [row["cycle"] for row in table] == ["9ms"] * 2 + ["10ms"] * 2 + ["11ms"] * 2
    assert all(82 < float(row["plant.stop_mm"]) < 85 for row in table)
    assert "plant.stop" in plot.read_text("utf-8")
    assert "6 of 6 runs" in capsys.readouterr().out


@pytest.mark.parametrize(("arguments", "said"), [
    (["--vary", "cycle"], "--vary cycle: found no name and values"),
    (["--plot", "x.txt"], "found the ending '.txt', expected one of .svg, .pdf, .png"),
    (["--csv", "no/such/folder/x.csv"], "it is a folder, or in no folder"),
    (["--set", "sweep.runs=0"], "sweep.runs: found 0, expected"),
])
def test_a_mistake_is_told_without_a_traceback(arguments, said, capsys):
    assert main(["sweep", str(CONVEYOR), *arguments]) == 2
    assert said in capsys.readouterr().err


def test_the_length_of_a_run_must_be_known(tmp_path, capsys):
    assert main(["sweep", str(write_config(tmp_path, "program: main.il\n"))]) == 2
    assert "give --until DURATION, or sweep.until" in capsys.readouterr().err


def test_ctrl_c_keeps_the_results_that_are_there(capsys, monkeypatch):
    def interrupted(plan, design):
        yield next(run_here(plan, design))
        raise KeyboardInterrupt

    monkeypatch.setattr("plcemu.cli.sweep.run_here", interrupted)
    assert main(["sweep", str(CONVEYOR), "--runs", "3", "--workers", "1"]) == 130
    assert "1 of 3 runs of 0.6 s, interrupted" in capsys.readouterr().out


def test_a_plan_for_workers_needs_no_files(tmp_path):
    path = write_config(tmp_path, "program: main.il\nsweep: {collect: pump}\n")
    design = Design((parse_variation("cycle=10ms,20ms"),))
    plan = make_plan(ConfigText.read(path), (), 100 * MS, design, ["pump"])
    (tmp_path / "main.il").unlink()
    path.unlink()
    assert len(results_of(run_on_cores(plan, design, 2))) == 2
    assert len(packed(plan)) < 100_000
