"""`plcemu reach` on the paper's conveyor under its compiled program."""

from __future__ import annotations

import csv
import json
from fractions import Fraction
from math import ceil, floor
from pathlib import Path

import pytest

from plcemu.cli.main import main

CONVEYOR = "il_programs/conveyor"


def answer(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, dict]:
    code = main(["reach", CONVEYOR, "--json", *arguments])
    return code, json.loads(capsys.readouterr().out)


def counted(cycle_ms: Fraction, speed: Fraction = Fraction(1, 5)) -> tuple[Fraction, Fraction]:
    """Return where one speed stops, by counting cycles of 0.5 % jitter (mm and ms)."""
    shortest, longest = cycle_ms * Fraction(995, 1000), cycle_ms * Fraction(1005, 1000)
    arrival = 80 / speed
    ends = [(max(n * shortest, arrival), min(n * longest, arrival + longest))
            for n in range(ceil(arrival / longest), floor(arrival / shortest) + 2)
            if (n - 1) * shortest < arrival]
    stops = [(speed * (a + shortest), speed * (b + longest)) for a, b in ends if a <= b]
    return min(a for a, _ in stops), max(b for _, b in stops)


def test_the_paper_s_check_value(capsys: pytest.CaptureFixture[str]) -> None:
    code, found = answer(capsys)
    assert code == 0
    assert found["stop_mm"] == [83.182, 84.018]
    assert found["range_mm"] == 0.836
    assert found["exact"] == ["41591/500", "42009/500"]
    assert found["conclusive"] is True


@pytest.mark.parametrize("cycle", ["1", "7.4", "9", "10", "13.1", "14.99"])
def test_without_perturbation_it_stops_where_counting_cycles_says(
        capsys: pytest.CaptureFixture[str], cycle: str) -> None:
    code, found = answer(capsys, "--set", f"cycle={cycle}ms")
    expected = counted(Fraction(cycle))
    assert code == 0
    assert [Fraction(text) for text in found["exact"]] == list(expected)


@pytest.mark.parametrize(("percent", "scenario_1"), [("0.4", True), ("0.41", False)])
def test_at_13_1_ms_the_range_reaches_1_5_mm_at_a_perturbation_of_0_8_percent(
        capsys: pytest.CaptureFixture[str], percent: str, scenario_1: bool) -> None:
    _, found = answer(capsys, "--set", "cycle=13.1ms", "--set", f"perturbation_pct={percent}")
    assert (found["range_mm"] <= 1.51) is scenario_1


def test_a_study_tells_the_values_within_a_limit(
        capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = tmp_path / "study.csv"
    code, found = answer(capsys, "--vary", "cycle=8.9ms..9.1ms:20us", "--within", "1.5",
                         "--csv", str(file), "--jobs", "1")
    assert code == 0
    assert found["within"]["stretches"] == [["8.94ms", "9.04ms"]]
    rows = list(csv.DictReader(file.read_text(encoding="utf-8").splitlines()))
    assert [row["cycle"] for row in rows[:2]] == ["8.9ms", "8.92ms"]
    assert Fraction(rows[2]["exact_low"]) == counted(Fraction("8.94"))[0]


def test_several_processes_answer_as_one_does(capsys: pytest.CaptureFixture[str]) -> None:
    vary = ("--vary", "cycle=12ms..13.4ms:20us")
    one = answer(capsys, *vary, "--jobs", "1")
    assert answer(capsys, *vary, "--jobs", "2") == one
    assert len(one[1]["values"]) == 71


def test_zones_and_polyhedra_agree_on_the_program(capsys: pytest.CaptureFixture[str]) -> None:
    few = ("--set", "cycle=60ms", "--set", "perturbation_pct=1")
    zones = answer(capsys, *few)
    assert answer(capsys, *few, "--set", "reach.regions=polyhedra") == zones


def test_a_limit_of_states_makes_it_inconclusive(capsys: pytest.CaptureFixture[str]) -> None:
    code, found = answer(capsys, "--set", "reach.states=5")
    assert code == 1
    assert found["conclusive"] is False
    assert "5 symbolic states" in found["reason"]


def test_a_study_is_drawn(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = tmp_path / "figure.svg"
    code = main(["reach", CONVEYOR, "--study", "figure10", "--set",
                 "reach.studies.figure10.vary=perturbation_pct=0..1:0.1", "--plot", str(file)])
    assert code == 0
    assert "<svg" in file.read_text(encoding="utf-8")
    assert "range at most 1.5 mm" in capsys.readouterr().out


@pytest.mark.parametrize(("arguments", "said"), [
    (("--study", "figure8"), "there is no study 'figure8'; there is figure7, figure9, figure10"),
    (("--vary", "cycle=1ms"), "range"),
    (("--vary", "nothing=1..2:1"), "there is no such parameter"),
    (("--objective", "speed"), "expected one of stop"),
    (("--plot", "x.svg"), "belong to a study"),
    (("--set", "plant.output_delay=none"), "expected cycle"),
])
def test_wrong_use_is_explained(capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...],
                                said: str) -> None:
    code = main(["reach", CONVEYOR, *arguments])
    told = capsys.readouterr()
    assert (code == 2 and said in told.err) or said in told.out


def test_a_plant_without_an_exact_model_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["reach", "il_programs/batch_plant"]) == 2
    assert "no exact model" in capsys.readouterr().err


def test_a_program_that_measures_time_is_refused(
        capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    chart = Path(CONVEYOR, "conveyor.sfc").read_text(encoding="utf-8")
    file = tmp_path / "timed.sfc"
    file.write_text(chart.replace(":= test_done;", ":= TEST.T > T#1s;"), encoding="utf-8")
    assert main(["reach", CONVEYOR, "--set", f"program={file}"]) == 2
    assert "reads timers or step times" in capsys.readouterr().err
