"""The commands: what they print, where, and their exit codes."""

from __future__ import annotations

import csv
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from systems import BATCH, STARTER

Run = Callable[..., Any]
ENVIRONMENT = {**os.environ, "COLUMNS": "100"}


def process(*arguments: object, **options: Any) -> subprocess.CompletedProcess[str]:
    """Run a command in a process of its own."""
    return subprocess.run([sys.executable, "-m", "plcemu", *map(str, arguments)], text=True,
                          capture_output=True, timeout=60, check=False, env=ENVIRONMENT, **options)


# every command


@pytest.mark.parametrize("command", [[], ["check"], ["run"], ["simulate"], ["plant"], ["monitor"],
                                     ["debug"]])
def test_every_command_explains_itself(plcemu: Run, command: list[str]) -> None:
    outcome = plcemu(*command, "--help")
    assert outcome.code == 0
    assert outcome.out.startswith("usage: plcemu") and outcome.err == ""


def test_the_version_is_told(plcemu: Run) -> None:
    assert plcemu("--version").out.startswith("plcemu ")


@pytest.mark.parametrize("arguments", [
    [], ["dance"], ["check"], ["simulate"], ["simulate", "--until"], ["simulate", "--until", "5"],
    ["simulate", "--until", "soon"], ["simulate", "--until=-5s"],
    ["simulate", "--until", "5s", "x", "y"],
    ["run", "--for", "1"], ["run", "--frobnicate"], ["plant", "."],
    ["plant", ".", "--connect", "host"],
    ["plant", ".", "--connect", "host:0"], ["plant", ".", "--connect", "host:99999"],
    ["plant", ".", "--connect", ":502"], ["plant", ".", "--connect", "h:502", "--unit", "256"],
    ["plant", ".", "--connect", "h:502", "--unit", "-1"], ["check", "a", "--dump", "soul"],
    ["monitor", "a"], ["simulate", "--unt", "5s"],
])
def test_wrong_usage_ends_with_2(plcemu: Run, arguments: list[str]) -> None:
    outcome = plcemu(*arguments)
    assert outcome.code == 2
    assert outcome.out == "" and "error" in outcome.err and "Traceback" not in outcome.err


@pytest.mark.parametrize("arguments", [
    ["simulate", "--until", "1s"], ["run", "--for", "1s"], ["plant", ".", "--connect", "h:1"]])
def test_a_missing_configuration_ends_with_2(plcemu: Run, arguments: list[str], tmp_path: Path,
                                             monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    outcome = plcemu(*arguments, "--json")
    assert outcome.code == 2
    assert "config.yaml: there is no such file" in outcome.err
    assert outcome.document["error"] == outcome.err.strip()
    assert len(outcome.document["problems"]) == 1


@pytest.mark.parametrize(("text", "code", "said"), [
    ("program: nowhere.il\n", 2, "nowhere.il:1:1: P0080 cannot read the file: No such file"),
    ("program: .\n", 2, "P0080 cannot read the file: Is a directory"),
    ("program: main.il\nproperties: nowhere.prop\n", 2,
     "config.yaml:2: properties: nowhere.prop: No such file or directory"),
    ("program: main.il\nproperties: wrong.prop\n", 1, "wrong.prop:1:6: "),
    ("program: wrong.il\n", 1, "wrong.il:1:"),
    ("program: main.il\ncycle: 10\n", 2, "config.yaml:2: cycle: found 10"),
    ("program: main.il\nproperties: [demands.prop, twice.prop]\n", 2,
     "there are two tags 'monitor.Calm.verdict'"),
])
def test_a_wrong_file_ends_with_its_place_and_no_traceback(plcemu: Run, config: Path, text: str,
                                                           code: int, said: str) -> None:
    (config / "wrong.il").write_text("PROGRAM")
    (config / "wrong.prop").write_text("a: G nowhere\n")
    (config / "twice.prop").write_text("Calm: G !pump\n")
    (config / "config.yaml").write_text(text)
    outcome = plcemu("simulate", "--until", "1s", "--json")
    assert outcome.code == code
    assert said in outcome.err and "Traceback" not in outcome.err
    assert said in outcome.document["error"]


# check


def test_a_good_program_is_ok(plcemu: Run, config: Path) -> None:
    outcome = plcemu("check", "main.il")
    assert outcome.code == 0
    assert outcome.out.startswith("ok: MAIN (")


def test_every_diagnostic_is_printed(plcemu: Run, config: Path) -> None:
    lines = "".join(f"  LD x{n}\n" for n in range(150))
    Path("bad.il").write_text(f"PROGRAM MAIN\nVAR a : INT; END_VAR\n{lines}END_PROGRAM\n")
    outcome = plcemu("check", "bad.il")
    assert outcome.code == 1
    assert outcome.err == ""
    assert sum(line.startswith("bad.il:") for line in outcome.out.splitlines()) >= 150


def test_diagnostics_are_plain_values_in_json(plcemu: Run, config: Path) -> None:
    Path("bad.il").write_text("PROGRAM MAIN\n LD x\nEND_PROGRAM\n")
    outcome = plcemu("check", "bad.il", "--json")
    assert outcome.code == 1
    assert outcome.document["ok"] is False
    found = outcome.document["diagnostics"][0]
    assert (found["file"], found["line"], found["severity"]) == ("bad.il", 2, "error")
    assert found["code"].startswith("P") and found["column"] >= 1 and found["message"]


def test_warnings_do_not_fail(plcemu: Run, config: Path) -> None:
    Path("warn.il").write_text(STARTER.replace("ratio : REAL", "ratio, unused : REAL"))
    outcome = plcemu("check", "warn.il")
    assert outcome.code == 0
    assert "unused" in outcome.out and "warning" in outcome.out


def test_what_the_engine_executes_can_be_seen(plcemu: Run, config: Path) -> None:
    tags = plcemu("check", "main.il", "--dump", "tags")
    assert "MAIN.pump BOOL %QX0.0\n" in tags.out
    assert plcemu("check", "main.il", "--dump", "ir").out
    assert "MAIN.pump" in plcemu("check", "main.il", "--dump", "tags", "--json").document["dump"]


@pytest.mark.parametrize("name", ["nowhere.il", "."])
def test_an_unreadable_file_is_wrong_use(plcemu: Run, config: Path, name: str) -> None:
    outcome = plcemu("check", "main.il", name)
    assert outcome.code == 2
    assert outcome.out.startswith(f"{name}:1:1: P0080 cannot read the file")


# simulate


def test_a_simulation_prints_one_document(plcemu: Run, config: Path) -> None:
    outcome = plcemu("simulate", "--until", "10s", "--json")
    assert (outcome.code, outcome.err) == (0, "")
    document = outcome.document
    assert {"t_s": document["t_s"], "scans": document["scans"], "overruns": document["overruns"]} \
        == {"t_s": 10.0, "scans": 1000, "overruns": 0}
    assert document["tags"]["MAIN.count"] == 0
    (entry,) = document["properties"]
    assert (entry["name"], entry["verdict"], entry["decided_at_s"]) == \
        ("calm", "presumably satisfied", None)


def test_a_violated_property_ends_with_1(plcemu: Run, config: Path) -> None:
    Path("demands.prop").write_text("busy: F[0s,5s] pump\n")
    outcome = plcemu("simulate", "--until", "10s", "--json")
    assert outcome.code == 1
    (entry,) = outcome.document["properties"]
    assert (entry["verdict"], entry["decided_at_s"]) == ("violated", 5.0)
    as_text = plcemu("simulate", "--until", "10s")
    assert as_text.code == 1
    assert "busy is violated: F[0s,5s] pump" in as_text.out


def test_a_fault_ends_with_1(plcemu: Run, config: Path) -> None:
    Path("main.il").write_text("PROGRAM MAIN\nVAR n, z : INT; pump : BOOL; END_VAR\nLD n\nDIV z\n"
                               "ST n\nLD pump\nST pump\nEND_PROGRAM\n")
    outcome = plcemu("simulate", "--until", "1s", "--json")
    assert (outcome.code, outcome.document["state"]) == (1, "FAULT")
    assert "MAIN" in outcome.document["fault"]
    assert "FAULT: " in plcemu("simulate", "--until", "1s").out


def test_no_time_at_all_is_no_mistake(plcemu: Run, config: Path) -> None:
    files = ("--trace", "t.csv", "--report", "t.html")
    outcome = plcemu("simulate", "--until", "0s", "--json", *files)
    assert (outcome.code, outcome.document["scans"], outcome.document["t_s"]) == (0, 0, 0.0)


@pytest.mark.parametrize("ending", ["csv", "jsonl", "vcd"])
def test_a_recorded_run_is_judged_like_the_run_itself(plcemu: Run, tmp_path: Path,
                                                      ending: str) -> None:
    trace = tmp_path / f"run.{ending}"
    live = plcemu("simulate", BATCH, "--until", "700s", "--set", "cycle=100ms", "--json",
                  "--trace", trace)
    later = plcemu("monitor", trace, BATCH / "properties.prop", "--json")
    assert (live.code, later.code) == (0, 0)
    keys = ("name", "verdict", "triggers", "decided_at_s")
    judged = [[tuple(p[k] for k in keys) for p in o.document["properties"]] for o in (live, later)]
    assert judged[0] == judged[1]


def test_a_csv_trace_has_a_column_for_each_tag_and_a_row_for_each_change(plcemu: Run,
                                                                       config: Path) -> None:
    outcome = plcemu("simulate", "--until", "10s", "--json", "--trace", "t.csv")
    rows = list(csv.reader(Path("t.csv").read_text().splitlines()))
    assert rows[0][0] == "t_ns" and rows[0][1:] == list(outcome.document["tags"])
    assert [row[0] for row in rows[1:]] == ["0", "9999999999"]
    assert rows[1][rows[0].index("MAIN.pump")] == "0"


@pytest.mark.parametrize(("option", "path", "said"), [
    ("--trace", "run", "found the ending ''"), ("--trace", "run.xls", "found the ending '.xls'"),
    ("--trace", "nowhere/run.csv", "cannot be written"), ("--report", ".", "cannot be written"),
    ("--report", "nowhere/r.html", "cannot be written")])
def test_a_file_that_cannot_be_written_is_refused_before_the_run(plcemu: Run, config: Path,
                                                                 option: str, path: str,
                                                                 said: str) -> None:
    outcome = plcemu("simulate", "--until", "10000h", "--dense", option, path)
    assert outcome.code == 2
    assert said in outcome.err


def test_a_report_is_a_page_of_its_own(plcemu: Run, tmp_path: Path) -> None:
    page = tmp_path / "run.html"
    plcemu("simulate", BATCH, "--until", "700s", "--set", "cycle=100ms", "--set",
           "name=<plant> & more", "--report", page)
    text = page.read_text(encoding="utf-8")
    assert "&lt;plant&gt; &amp; more" in text and "<plant>" not in text
    assert "no_overflow" in text and "BATCH_PLANT.V8" in text
    assert "http" not in text.replace("http://www.w3.org", "")


def test_text_that_looks_like_markup_is_printed_as_it_is(plcemu: Run, config: Path) -> None:
    Path("demands.prop").write_text('odd "[red]alarm[/nothing] :warning:": F[0s,1s] pump\n')
    outcome = plcemu("simulate", "--until", "10s", "--set", "name=a [/bold]")
    assert "[red]alarm[/nothing] :warning:" in outcome.out
    assert outcome.out.startswith("a [/bold]: RUN")


def test_dense_and_skipping_simulations_write_the_same_bytes(plcemu: Run, tmp_path: Path) -> None:
    written = []
    for option in ([], ["--dense"]):
        plcemu("simulate", BATCH, "--until", "400s", "--set", "cycle=200ms", "--trace",
               tmp_path / "t.jsonl", *option)
        written.append((tmp_path / "t.jsonl").read_bytes())
    assert written[0] == written[1]


def test_an_override_reaches_the_plant(plcemu: Run) -> None:
    outcome = plcemu("simulate", BATCH, "--until", "10s", "--set", "load=0", "--json")
    assert outcome.document["plant"]["produces"] is False
    assert outcome.document["plant"]["reason"]


# monitor


def test_a_violated_recording_ends_with_1(plcemu: Run, config: Path) -> None:
    Path("t.csv").write_text("t_ns,pump\n0,0\n1000000000,1\n2000000000,0\n")
    assert plcemu("monitor", "t.csv", "demands.prop", "--json").code == 1
    outcome = plcemu("monitor", "t.csv", "demands.prop")
    assert (outcome.code, "violated" in outcome.out) == (1, True)


@pytest.mark.parametrize(("trace", "text", "said"), [
    ("t.csv", "1,2,3\n", "t.csv:1: found"), ("t.csv", "", "t.csv:1: found"),
    ("t.csv", "t_ns,pump\nsoon,1\n", "t.csv:2: found 'soon'"), ("t.txt", "", "found the ending"),
    ("t.jsonl", "{", "t.jsonl:1: "), ("t.vcd", "nonsense", "t.vcd")])
def test_a_recording_that_is_none_ends_with_2(plcemu: Run, config: Path, trace: str, text: str,
                                              said: str) -> None:
    Path(trace).write_text(text)
    outcome = plcemu("monitor", trace, "demands.prop", "--json")
    assert outcome.code == 2
    assert said in outcome.err and "Traceback" not in outcome.err
    assert outcome.document["problems"]


@pytest.mark.parametrize("missing", ["t.csv", "demands.prop"])
def test_a_recording_or_properties_that_are_not_there_end_with_2(plcemu: Run, config: Path,
                                                                 missing: str) -> None:
    Path("t.csv").write_text("t_ns,pump\n0,0\n")
    Path(missing).unlink()
    outcome = plcemu("monitor", "t.csv", "demands.prop")
    assert (outcome.code, f"{missing}: there is no such file" in outcome.err) == (2, True)


def test_a_property_of_no_tag_in_the_recording_ends_with_1(plcemu: Run, config: Path) -> None:
    Path("t.csv").write_text("t_ns,pmup\n0,0\n")
    outcome = plcemu("monitor", "t.csv", "demands.prop")
    assert outcome.code == 1
    assert "demands.prop:1:" in outcome.err and "pmup" in outcome.err


# run


def test_a_run_ends_by_itself_and_reports(plcemu: Run, config: Path) -> None:
    outcome = plcemu("run", "--for", "200ms", "--json")
    assert outcome.code == 0
    document = outcome.document
    assert document["t_s"] == 0.2 and document["state"] == "STOP"
    assert document["scans"] + document["missed"] == 20
    assert {"requests", "connections_open"} <= set(document["modbus"])
    assert document["timing"]["max_lap_ms"] > 0


def test_a_run_prints_its_report_for_people(plcemu: Run, config: Path) -> None:
    outcome = plcemu("run", "--for", "100ms", "--set", "modbus.enabled=false")
    assert outcome.out.startswith("starter: STOP at 0.1 s, ")
    assert "outputs are at their safe values" in outcome.err


def test_a_run_whose_program_faults_says_so_and_ends_with_1(plcemu: Run, config: Path) -> None:
    Path("main.il").write_text("PROGRAM MAIN\nVAR n, z : INT; pump : BOOL; END_VAR\nLD n\nDIV z\n"
                               "ST n\nLD pump\nST pump\nEND_PROGRAM\n")
    outcome = plcemu("run", "--for", "100ms", "--json")
    assert (outcome.code, outcome.document["state"]) == (1, "FAULT")
    assert "FAULT: " in outcome.err and "safe values" in outcome.err


def test_a_run_tells_a_violation_when_it_happens(plcemu: Run, config: Path) -> None:
    Path("demands.prop").write_text("busy: F[0s,50ms] pump\n")
    outcome = plcemu("run", "--for", "200ms", "--json")
    assert outcome.code == 1
    assert "property busy is violated" in outcome.err


def test_a_port_in_use_is_told(plcemu: Run, config: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        outcome = plcemu("run", "--for", "1s", "--set", f"port={port}", "--json")
    assert outcome.code == 2
    assert f"127.0.0.1:{port}: address already in use" in outcome.err
    assert "address already in use" in outcome.document["error"]


# plant


def test_a_plant_without_a_plc_waits_for_it(plcemu: Run, tmp_path: Path) -> None:
    outcome = plcemu("plant", BATCH, "--connect", "127.0.0.1:1", "--for", "300ms", "--json",
                     "--state", tmp_path / "state.json", "--set", "time_scale=10")
    assert outcome.code == 0
    assert (outcome.document["steps"], outcome.document["outages"]) == (0, 0)
    assert outcome.document["plant"]["t_s"] == 0
    assert outcome.err.count("no Modbus server answers at 127.0.0.1:1") == 1
    assert not (tmp_path / "state.json").exists()


@pytest.mark.parametrize("overrides", [["modbus.field_window=false"],
                                       ["plant.inputs.B1.level=%IB7"]])
def test_a_wiring_that_modbus_cannot_show_is_refused(plcemu: Run, overrides: list[str]) -> None:
    outcome = plcemu("plant", BATCH, "--connect", "127.0.0.1:1", "--fresh",
                     *(a for o in overrides for a in ("--set", o)))
    assert outcome.code == 2
    assert "the Modbus map does not show %I" in outcome.err


def test_a_configuration_without_a_plant_has_none_to_run(plcemu: Run, config: Path) -> None:
    outcome = plcemu("plant", ".", "--connect", "127.0.0.1:1")
    assert (outcome.code, "has no plant" in outcome.err) == (2, True)


def test_a_state_file_that_cannot_be_written_is_refused(plcemu: Run, tmp_path: Path) -> None:
    outcome = plcemu("plant", BATCH, "--connect", "127.0.0.1:1", "--state",
                     tmp_path / "nowhere" / "s.json")
    assert (outcome.code, "cannot keep the plant's state" in outcome.err) == (2, True)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"saved": 0}', "\0", '{"key": 5, "saved": "x"}'])
def test_a_state_file_of_something_else_is_not_gone_on_from(plcemu: Run, tmp_path: Path,
                                                            text: str) -> None:
    state = tmp_path / "state.json"
    state.write_text(text)
    outcome = plcemu("plant", BATCH, "--connect", "127.0.0.1:1", "--for", "50ms", "--state", state)
    assert outcome.code == 0
    assert "going on" not in outcome.err


# processes


def test_a_process_gives_the_exit_code(config: Path) -> None:
    assert process("simulate", "--until", "1s", "--json").returncode == 0
    assert process("simulate", "--until", "1").returncode == 2
    assert process("simulate", "--until", "1s", "--set", "cycle=5").returncode == 2


def test_output_into_a_pipe_that_closes_is_no_traceback(config: Path) -> None:
    ended = subprocess.run(f"{sys.executable} -m plcemu check main.il --dump ir | head -1",
                           shell=True, text=True, capture_output=True, timeout=60, check=True)
    assert "Traceback" not in ended.stderr and "BrokenPipe" not in ended.stderr


@pytest.mark.parametrize("redirection", [">/dev/full", ">&-"])
def test_output_that_goes_nowhere_is_no_traceback(config: Path, redirection: str) -> None:
    for command in ("simulate --until 1s --json", "check main.il", "simulate --until 1s"):
        ended = subprocess.run(f"{sys.executable} -m plcemu {command} {redirection}", shell=True,
                               text=True, capture_output=True, timeout=60, check=False)
        assert "Traceback" not in ended.stderr and "Exception" not in ended.stderr


def test_any_name_can_be_printed_on_any_terminal(config: Path) -> None:
    environment = {**ENVIRONMENT, "PYTHONIOENCODING": "ascii"}
    for option in ([], ["--json"]):
        ended = subprocess.run([sys.executable, "-m", "plcemu", "simulate", "--until", "1s",
                                "--set", "name=Köln µ", *option], text=True, capture_output=True,
                               timeout=60, check=False, env=environment)
        assert (ended.returncode, ended.stderr) == (0, "")


def test_ctrl_c_ends_a_simulation_without_a_traceback(config: Path) -> None:
    (config / "main.il").write_text("PROGRAM m VAR pump, idle : BOOL; END_VAR LD pump ST pump "
                                    "END_PROGRAM", encoding="utf-8")
    simulation = subprocess.Popen([sys.executable, "-m", "plcemu", "simulate", "--until", "10000h",
                                   "--dense", "--trace", "t.csv"], stderr=subprocess.PIPE,
                                  stdout=subprocess.PIPE, text=True)
    assert simulation.stderr is not None
    # The warning tells that the run begins.
    assert "'idle' is never used" in simulation.stderr.readline()
    simulation.send_signal(signal.SIGINT)
    out, err = simulation.communicate(timeout=10)
    assert simulation.returncode == 130
    assert (out, err) == ("", "plcemu: interrupted\n")
