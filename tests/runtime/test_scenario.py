"""Scenarios: reading them, faults in the plant, writes to tags at their instants."""

from __future__ import annotations

from pathlib import Path

import pytest
from systems import MS, S, system_of

from hil.coupling import PlantFailure
from plant_sim import load
from plant_sim.faults import Injection
from plcemu.base.errors import ConfigError
from plcemu.base.trace import Trace
from plcemu.runtime.scenario import (
    Scenario,
    dump_scenario,
    injections_of,
    load_scenario,
    parse_fault,
    refuse_tags,
)
from plcemu.runtime.system import System


def scenario(folder: Path, text: str) -> Scenario:
    path = folder / "scenario.yaml"
    path.write_text(text, encoding="utf-8")
    return load_scenario(path)


def traced(system: System, until_ns: int) -> Trace:
    trace = Trace(system.cycle.tags)
    system.cycle.observers.append(trace)
    system.cycle.run_virtual(until_ns)
    return trace


# reading


def test_instants_are_durations_seconds_or_nanoseconds(tmp_path: Path) -> None:
    found = scenario(tmp_path, """
description: three ways
steps:
  - {t_ns: 3, set: {a: 1}}
  - {at: 1.5s, fault: stuck, target: V8, until_s: 2.25}
  - {at_s: 0.1, force: {a: true}, unforce: b}
""")
    assert [step.t_ns for step in found.steps] == [3, 100 * MS, 1500 * MS]
    assert found.steps[2].injection == Injection(1500 * MS, "V8", "stuck", None, 2250 * MS)


def test_a_file_may_be_a_bare_list(tmp_path: Path) -> None:
    assert len(scenario(tmp_path, "- {at: 1s, fault: lost, target: x}").steps) == 1


@pytest.mark.parametrize(("text", "said"), [
    ("steps:\n  - {fault: stuck, target: V8}", "yaml:2: steps.0: .*expected one of at"),
    ("steps:\n  - {at: 1s, t_ns: 4, set: {a: 1}}", "expected one of at"),
    ("steps:\n  - {at: 10, set: {a: 1}}", "steps.0.at: found 10, expected a number with a unit"),
    ("steps:\n  - {at: 1s}", "expected a fault with its target, or set"),
    ("steps:\n  - {at: 1s, fault: stuck}", "expected fault and target together"),
    ("steps:\n  - {at: 1s, set: {a: 1}, value: 3}", "value and until with a fault only"),
    ("- {at: 1s, falt: stuck}", "there is no key .*falt'; did you mean 'fault'"),
    ("steps:\n  - {at_s: 1.0000000001, set: {a: 1}}", "in whole ns"),
    ("steps: 3", "found 3, expected a list"),
    ("3", "expected a list of steps"),
])
def test_mistakes_are_told_with_their_place(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        scenario(tmp_path, text)


@pytest.mark.parametrize(("text", "injection"), [
    ("V8 stuck at 100s", Injection(100 * S, "V8", "stuck")),
    ("V8 wrong sign", Injection(0, "V8", "wrong_sign")),
    ("B3 leak 0.02 at 5min until 10 min", Injection(300 * S, "B3", "leak", 0.02, 600 * S)),
    ("B3.level drift -1e-3 from T#1s500ms", Injection(1500 * MS, "B3.level", "drift", -0.001)),
    ("V8 stuck true until 1s", Injection(0, "V8", "stuck", True, S)),
])
def test_a_fault_in_one_line(text: str, injection: Injection) -> None:
    assert parse_fault(text).steps[0].injection == injection


@pytest.mark.parametrize("text", ["", "V8", "V8 at 3s"])
def test_what_is_no_fault_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="--fault"):
        parse_fault(text)


@pytest.mark.parametrize(("text", "said"), [
    ("V88 stuck", "did you mean V8"),
    ("B9 leak 0.1", "the plant has no 'B9'"),
    ("V8 leak 0.1", "V8 cannot have the fault 'leak'; it can have stuck, open, closed"),
    ("B3 drift 0.1", "B3 cannot have the fault 'drift'; it can have leak"),
    ("V8 drift 1", "V8 cannot have the fault 'drift'"),
    ("B3 leak", "B3.leak needs a value, 0 to 0.5 l/s"),
    ("B3 leak 0.6", "expected 0 to 0.5 l/s"),
    ("B3.level stuck 99", "expected 0 to 7.5 l"),
    ("V8 open 1", "open takes no value"),
    ("B3.level slow", "slow needs a value, in s"),
    ("V8 stuck from 5s until 5s", "ends before it begins"),
])
def test_a_fault_that_there_cannot_be_is_refused_with_what_there_can(text: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        injections_of(parse_fault(text), load("batch_plant"), 1)  # type: ignore[arg-type]


# tags


def test_tags_addresses_and_forces_take_effect_at_the_first_lap_not_before_them(
        tmp_path: Path) -> None:
    played = scenario(tmp_path, """
- {at: 25ms, set: {start: true, "%IW1": 7}}
- {at: 40ms, set: {pause: 100ms}}
- {at: 500ms, force: {pump: false}}
- {at: 600ms, unforce: pump}
- {at: 900ms, set: {start: false}}
""")
    system = system_of(tmp_path)
    trace = traced(System(system.config, scenario=played), S)
    assert trace.history("start") == [(0, False), (30 * MS, True), (900 * MS, False)]
    assert trace.history("level")[1] == (30 * MS, 7)
    assert trace.history("pump") == [(0, False), (130 * MS, True), (500 * MS, False),
                                     (600 * MS, True), (900 * MS, False)]


def test_skipping_and_dense_runs_play_the_same(tmp_path: Path) -> None:
    played = scenario(tmp_path, "- {at: 5.005s, set: {start: true}}\n"
                                "- {at: 9s, set: {level: 3}}")
    config = system_of(tmp_path).config
    runs = [System(config, scenario=played) for _ in range(2)]
    traces = [Trace(run.cycle.tags) for run in runs]
    for run, trace, dense in zip(runs, traces, (False, True), strict=True):
        run.cycle.observers.append(trace)
        run.cycle.run_virtual(20 * S, dense=dense)
    assert traces[0].history("pump") == traces[1].history("pump")
    assert traces[0].history("speed") == traces[1].history("speed") == [(0, 0), (9 * S, 3)]


@pytest.mark.parametrize(("step", "said"), [
    ("set: {nowhere: 1}", "scenario.yaml:1: there is no tag 'nowhere'"),
    ("set: {start: 7}", "scenario.yaml:1: start"),
    ("set: {count: hello}", "scenario.yaml:1: count"),
    ("force: {nowhere: 1}", "there is no tag"),
    ("unforce: nowhere", "there is no tag"),
    ("fault: stuck, target: V8", "scenario.yaml:1: there is no plant in this process"),
])
def test_what_the_plc_cannot_have_is_refused_before_the_run(tmp_path: Path, step: str,
                                                            said: str) -> None:
    played = scenario(tmp_path, f"- {{at: 1s, {step}}}")
    config = system_of(tmp_path).config
    with pytest.raises(ConfigError, match=said):
        System(config, scenario=played)


def test_what_is_written_reads_back_and_plays(tmp_path: Path) -> None:
    path = tmp_path / "counterexample.yaml"
    path.write_text(dump_scenario([(0, {"start": False}), (20 * MS, {"start": True, "level": 5})],
                                  "found by the checker"), encoding="utf-8")
    trace = traced(System(system_of(tmp_path).config, scenario=load_scenario(path)), 100 * MS)
    assert trace.history("start") == [(0, False), (20 * MS, True)]
    assert trace.history("level") == [(0, 0), (20 * MS, 5)]


# plants

EVAPORATOR = """
plant:
  model: evaporator
  seed: 3
  inputs: {Malf: "%IX0.0", T1E: "%IX0.1"}
"""


def test_a_disturbance_may_be_set_as_a_tag(tmp_path: Path) -> None:
    played = scenario(tmp_path, """
- {at: 1s, set: {plant.condenser.malfunction: true}}
- {at: 2s, set: {plant.condenser.malfunction: false}}
""")
    config = system_of(tmp_path, EVAPORATOR).config
    trace = traced(System(config, scenario=played), 3 * S)
    assert trace.history("plant.Malf") == [(0, False), (S, True), (2 * S, False)]
    assert trace.history("plant.faults") == [(0, 0), (S, 1), (2 * S, 0)]
    refuse_tags(played, load("evaporator"))


def test_a_configuration_may_name_its_scenario(tmp_path: Path) -> None:
    scenario(tmp_path, "- {at: 1s, fault: malfunction, target: condenser}")
    text = EVAPORATOR.replace("seed: 3", "scenario: scenario.yaml")
    trace = traced(system_of(tmp_path, text), 2 * S)
    assert trace.history("plant.Malf") == [(0, False), (S, True)]


def test_times_are_the_plcs_also_where_the_plant_runs_faster(tmp_path: Path) -> None:
    config = system_of(tmp_path, EVAPORATOR.replace("seed: 3", "time_scale: 100")).config
    trace = traced(System(config, scenario=parse_fault("condenser malfunction at 1s")), 2 * S)
    assert trace.history("plant.Malf") == [(0, False), (S, True)]


def test_an_input_that_the_plant_drives_cannot_be_set_but_forced(tmp_path: Path) -> None:
    config = system_of(tmp_path, EVAPORATOR).config
    played = scenario(tmp_path, '- {at: 1s, set: {"%IX0.0": true}}')
    with pytest.raises(ConfigError, match="driven by the plant's Malf: use a fault"):
        System(config, scenario=played)
    forced = scenario(tmp_path, "- {at: 1s, force: {start: true}}")
    assert traced(System(config, scenario=forced), 2 * S).history("start")[-1] == (S, True)


def test_a_plant_alone_refuses_tags_of_a_plc(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="start is a tag of the PLC"):
        refuse_tags(scenario(tmp_path, "- {at: 1s, set: {start: true}}"), load("evaporator"))


@pytest.mark.parametrize(("devices", "said"), [
    ("{Nowhere: {delay: 1s}}", "has no such sensor or actuator"),
    ("{V1: {noise: 1.0}}", "can have a travel time only"),
    ("{T1E: {noise: 1.0}}", "can have a delay only"),
    ("{T1E: {travel: 1s}}", "has no travel time"),
    ("{T1E: {dellay: 1s}}", "there is no key .*did you mean 'delay'"),
])
def test_devices_that_a_port_cannot_have_are_refused(tmp_path: Path, devices: str,
                                                     said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        system_of(tmp_path, EVAPORATOR.replace("seed: 3", f"devices: {devices}"))


def test_a_users_plant_that_fails_is_told_with_its_line(tmp_path: Path) -> None:
    (tmp_path / "bad.py").write_text("""
from plant_sim.automaton import HybridAutomaton, Linear, Mode, rises

class Bad(HybridAutomaton):
    name = "bad"
    def elements(self): return ()
    def begin(self): return {"x": 0}
    def mode(self, x, on):
        1 / (x["x"] < 1)
        return Mode({"x": Linear(1)}, [rises("one", "x", 1)])
""", encoding="utf-8")
    with pytest.raises(PlantFailure, match=r"plant bad at 1 s: ZeroDivisionError.*bad.py:9"):
        system_of(tmp_path, "plant: {model: bad.py}").cycle.run_virtual(2 * S)
