"""Proofs over a program alone: every input may change at any time."""

from itertools import product
from pathlib import Path

import pytest

import plcemu
from plcemu.base.errors import ConfigError
from plcemu.runtime.config import load_config
from plcemu.runtime.verification import make_prover

PUMP = """PROGRAM MAIN
VAR start AT %IX0.0 : BOOL; stop AT %IX0.1 : BOOL; level AT %IW0 : UINT;
    pump AT %QX0.0 : BOOL; late : TON; END_VAR
IF start THEN pump := TRUE; END_IF;
IF stop OR level > 900 THEN pump := FALSE; END_IF;
END_PROGRAM
"""
LEVELS = [0, 900, 901, 60_000]


@pytest.fixture
def verdicts(tmp_path: Path):
    """Write a program and properties; return the verdicts, and what was cut away or assumed."""
    def of(program: str, properties: str, *settings: str) -> tuple[dict[str, str], list[str]]:
        (tmp_path / "p.st").write_text(program)
        (tmp_path / "p.prop").write_text(properties)
        (tmp_path / "config.yaml").write_text(
            "program: p.st\nverify: {abstraction: free_inputs, properties: p.prop}\n")
        result = make_prover(load_config(tmp_path, settings)).prove()
        return {p.name: p.finding.verdict for p in result.proofs}, result.cuts
    return of


def test_without_a_plant_the_program_s_own_inputs_are_free(verdicts):
    found, _ = verdicts(PUMP, "off: G (stop -> !pump)\n full: G (level >= 901 -> !pump)\n"
                              "never: G !pump\n wrong: G (level >= 900 -> !pump)\n",
                        f"verify.parameters.level={LEVELS}")

    assert found == {"off": "holds", "full": "holds", "never": "violated", "wrong": "violated"}


def test_the_states_that_are_found_are_those_of_brute_force(tmp_path):
    (tmp_path / "p.st").write_text(PUMP)
    (tmp_path / "p.prop").write_text("seen: G (pump | !pump)\n")
    (tmp_path / "config.yaml").write_text(
        "program: p.st\nverify: {abstraction: free_inputs, properties: p.prop, "
        f"parameters: {{level: {LEVELS}}}}}\n")
    states = set()
    for history in product(product((False, True), (False, True), LEVELS), repeat=2):
        plc = plcemu.Plc(plcemu.compile(PUMP))
        for plc["start"], plc["stop"], plc["level"] in history:
            plc.scan()
            states.add((plc["start"], plc["stop"], plc["level"], plc["pump"]))

    graph = make_prover(load_config(tmp_path)).prove().graph

    assert len(graph) == len(states)


def test_a_timer_that_is_never_called_does_not_count_as_reading_time(verdicts):
    found, cuts = verdicts(PUMP, "off: G (stop -> !pump)\n", "verify.parameters.level=0")

    assert found == {"off": "holds"}
    assert any("MAIN.late" in cut for cut in cuts)


def test_an_unsigned_input_reads_large_values_as_they_are(verdicts):
    found, _ = verdicts(PUMP, "large: EF level = 60000\n", f"verify.parameters.level={LEVELS}")

    assert found == {"large": "holds"}


@pytest.mark.parametrize(("settings", "text"), [
    ((), "verify.parameters.level: is missing: which values may level (%IW0) read? Give a list"),
    (("verify.parameters.level=[0, 70000]",), "level (%IW0) cannot read 70000"),
    (("verify.parameters.level=-1",), "level (%IW0) cannot read -1"),
    (("verify.parameters.level=high",), "found 'high', expected a number"),
    (("verify.parameters.level=0", "verify.parameters.stob=true"),
     "is no input; did you mean 'stop'?"),
    (("verify.abstraction=null",), "free_inputs lets every input of the program change"),
])
def test_what_does_not_fit_is_told(verdicts, settings, text):
    with pytest.raises(ConfigError) as caught:
        verdicts(PUMP, "off: G (stop -> !pump)\n", *settings)

    assert text in str(caught.value)


def test_a_real_input_cannot_be_free(verdicts):
    program = ("PROGRAM MAIN VAR x AT %ID0 : REAL; y AT %QX0.0 : BOOL; END_VAR y := x > 1.0; "
               "END_PROGRAM")

    with pytest.raises(ConfigError, match="is of type REAL"):
        verdicts(program, "p: G !y\n")


@pytest.mark.parametrize(("abstraction", "verdict"), [
    ("free_inputs", "violated"), ("plant_sim.free_inputs:FreeInputs", "holds")])
def test_inputs_that_a_plant_does_not_drive_are_free_or_it_is_told_that_they_stand_still(
        tmp_path, abstraction, verdict):
    (tmp_path / "p.st").write_text("""PROGRAM MAIN
VAR i1 AT %IX0.1 : BOOL; hand AT %IX7.0 : BOOL; lamp AT %QX0.0 : BOOL; END_VAR
lamp := i1 OR hand; END_PROGRAM""")
    (tmp_path / "p.prop").write_text("same: G (lamp = MAIN.i1)\n")
    (tmp_path / "config.yaml").write_text(
        "program: p.st\nplant: {model: heating_tank, inputs: {i1: '%IX0.1'}}\n"
        "verify: {properties: p.prop, parameters: {i1: [false, true]}, "
        f"abstraction: '{abstraction}'}}\n")

    result = make_prover(load_config(tmp_path)).prove()

    assert result.proofs[0].finding.verdict == verdict
    assert ("nothing writes the inputs MAIN.hand (%IX7.0): they stay as at the start"
            in result.cuts) == (verdict == "holds")


def test_a_plant_without_an_abstraction_is_told_what_there_is(tmp_path):
    (tmp_path / "p.st").write_text(PUMP)
    (tmp_path / "config.yaml").write_text(
        "program: p.st\nplant: {model: conveyor}\nverify: {abstraction: conveyor}\n")

    with pytest.raises(ConfigError, match="or free_inputs: every input may change"):
        make_prover(load_config(tmp_path))
