"""The final scan of the standard as an option (IEC 61131-3, 2.6.4.5, figures 14 and 15).

A column of a line is one scan of 10 ms; `runs` tells how often the action has run after each scan.
Step B follows `go` from the second scan on, step C follows `reset`.
"""

import pytest
from controller import Controller

import plcemu
from plcemu.lang.compile import compile_program
from plcemu.runtime.config import load_config
from plcemu.runtime.system import System

CHART = """
PROGRAM MAIN
VAR go, reset, out, done : BOOL; n : INT; END_VAR
INITIAL_STEP A: {a} END_STEP
STEP B: {b} END_STEP
INITIAL_STEP O: END_STEP
STEP C: {c} END_STEP
TRANSITION FROM A TO B := go; END_TRANSITION
TRANSITION FROM B TO A := NOT go; END_TRANSITION
TRANSITION FROM O TO C := reset; END_TRANSITION
TRANSITION FROM C TO O := NOT reset; END_TRANSITION
ACTION count: n := n + 1; END_ACTION
ACTION last: done := NOT B.X; END_ACTION
END_PROGRAM
"""


def runs(go, b, reset="", a="", c="", final_scan=True):
    controller = Controller(compile_program(CHART.format(a=a, b=b, c=c), final_scan=final_scan))
    counts = []
    for level, other in zip(go, reset or "_" * len(go), strict=True):
        controller.diagram({"go": level, "reset": other}, [])
        counts.append(controller["n"])
    return [after - before for before, after in zip([0, *counts], counts, strict=False)]


def with_final_scan(b):
    return Controller(compile_program(CHART.format(a="", b=b, c=""), final_scan=True))


def test_without_the_option_an_action_does_not_run_in_the_scan_in_which_it_ends():
    assert runs("__--___", "count(N);", final_scan=False) == [0, 0, 1, 1, 0, 0, 0]


@pytest.mark.parametrize(("block", "go", "expected"), [
    ("count(N);", "__--___", [0, 0, 1, 1, 1, 0, 0]),
    ("count(P);", "__---__", [0, 0, 1, 1, 0, 0, 0]),
    ("count(P1);", "__---__", [0, 0, 1, 0, 0, 0, 0]),
    ("count(P0);", "__---__", [0, 0, 0, 0, 0, 1, 0]),
    ("count(L, T#20ms);", "__-----_", [0, 0, 1, 1, 1, 0, 0, 0]),
    ("count(D, T#20ms);", "__----__", [0, 0, 0, 0, 1, 1, 1, 0]),
    ("count(SL, T#20ms);", "__-_____", [0, 0, 1, 1, 1, 0, 0, 0]),
    ("count(S);", "__-_____", [0, 0, 1, 1, 1, 1, 1, 1]),
])
def test_each_qualifier_runs_its_action_once_more(block, go, expected):
    assert runs(go, block) == expected


def test_r_ends_a_stored_action_with_a_final_scan():
    assert runs("__-____", "count(S);", reset="____-__", c="count(R);") == [0, 0, 1, 1, 1, 0, 0]


def test_an_action_that_goes_on_in_the_next_step_has_no_final_scan_between():
    assert runs("__--__", "count(N);", a="count(N);") == [1, 1, 1, 1, 1, 1]


def test_the_final_scan_sees_its_step_inactive():
    controller = with_final_scan("last(N);")
    assert controller.diagram({"go": "__--__"}, ["done"]) == {"done": "____--"}


def test_a_boolean_variable_is_false_in_the_final_scan():
    controller = with_final_scan("out(N);")
    assert controller.diagram({"go": "__--__"}, ["out"]) == {"out": "__--__"}


def test_a_chart_that_stands_still_with_the_option_is_quiet():
    controller = with_final_scan("count(N);")
    assert controller.scan(2).resource.is_quiet()


def test_the_public_compile_takes_the_option():
    plc = plcemu.Plc(plcemu.compile(CHART.format(a="", b="count(N);", c=""), final_scan=True))
    plc.scan()
    plc["go"] = True
    plc.scan()
    plc["go"] = False
    plc.scan(3)
    assert plc["n"] == 2


@pytest.mark.parametrize(("line", "expected"), [("", 1), ("sfc_final_scan: true\n", 2)])
def test_the_configuration_has_the_option(tmp_path, line, expected):
    (tmp_path / "p.st").write_text(CHART.format(a="count(N);", b="", c="").replace("go :", "g :")
                                   .replace(":= go;", ":= TRUE;").replace(":= NOT go;", ":= FALSE;")
                                   .replace("go,", ""))
    (tmp_path / "config.yaml").write_text(f"program: p.st\n{line}")
    system = System(load_config(tmp_path))
    system.cycle.run_virtual(50_000_000)
    assert system.report()["tags"]["MAIN.n"] == expected
