"""Bistables, edges and counters (IEC 61131-3, tables 34 to 36), scan by scan."""

import pytest
from controller import Controller, main


@pytest.mark.parametrize(("block", "first", "second", "q"), [
    ("SR", "_-__-__", "____--_", "_----__"),
    ("RS", "_-__-__", "____--_", "_---___"),
])
def test_bistables_differ_in_which_input_wins(block, first, second, q):
    inputs = {"SR": "S1 := a, R := b", "RS": "S := a, R1 := b"}[block]
    controller = Controller(main(f"f : {block}; a, b : BOOL;", f"f({inputs});"))
    assert controller.diagram({"a": first, "b": second}, ["Q1"]) == {"Q1": q}


@pytest.mark.parametrize(("line", "q"), [("_--__-_-", "_-___-_-"), ("--_-", "-__-")])
def test_rising_edges_last_one_scan(line, q):
    controller = Controller(main("f : R_TRIG; a : BOOL;", "f(CLK := a);"))
    assert controller.diagram({"a": line}, ["Q"]) == {"Q": q}


@pytest.mark.parametrize(("line", "q"), [
    ("_--__-_-", "-__-__-_"), ("--_-", "__-_"), ("__-_", "-__-")])
def test_falling_edges_last_one_scan_and_false_at_the_start_is_one(line, q):
    controller = Controller(main("f : F_TRIG; a : BOOL;", "f(CLK := a);"))
    assert controller.diagram({"a": line}, ["Q"]) == {"Q": q}


def counter(block, call, lines, outputs=("CV",), pv=2):
    declared = "".join(f"{name} : BOOL;" for name in lines)
    controller = Controller(main(f"c : {block}; {declared}", call.replace("PV", f"PV := {pv}")))
    found = {name: [] for name in outputs}
    for column in zip(*lines.values(), strict=True):
        controller.diagram({f"MAIN.{n}": level for n, level in zip(lines, column, strict=True)}, [])
        for name in outputs:
            found[name].append(controller[f"c.{name}"])
    return found


def test_ctu_counts_rising_edges_up_and_resets():
    found = counter("CTU", "c(CU := up, R := reset, PV);",
                    {"up": "_-_--_-__-", "reset": "_______-_-"}, ("CV", "Q"))
    assert found == {"CV": [0, 1, 1, 2, 2, 2, 3, 0, 0, 0],
                     "Q": [False, False, False, True, True, True, True, False, False, False]}


def test_ctd_counts_down_from_its_preset():
    found = counter("CTD", "c(CD := down, LD := load, PV);",
                    {"down": "__-_--_-", "load": "-_______"}, ("CV", "Q"))
    assert found == {"CV": [2, 2, 1, 1, 0, 0, 0, -1],
                     "Q": [False, False, False, False, True, True, True, True]}


def test_ctud_counts_both_ways_and_not_at_all_on_both_edges_at_once():
    found = counter("CTUD", "c(CU := up, CD := down, R := reset, LD := load, PV);",
                    {"up": "-_-_-___", "down": "____-_-_", "reset": "_______-", "load": "________"},
                    ("CV", "QU", "QD"))
    assert found["CV"] == [1, 1, 2, 2, 2, 2, 1, 0]
    assert found["QU"] == [False, False, True, True, True, True, False, False]
    assert found["QD"] == [False] * 7 + [True]


def test_reset_wins_over_load_and_load_over_counting():
    found = counter("CTUD", "c(CU := up, CD := down, R := reset, LD := load, PV);",
                    {"up": "_-__", "down": "____", "reset": "__-_", "load": "-_-_"})
    assert found == {"CV": [2, 3, 0, 0]}


@pytest.mark.parametrize(("block", "call", "start", "end"), [
    ("CTU", "c(CU := a, PV := 0);", 32766, 32767), ("CTD", "c(CD := a, PV := 0);", -32767, -32768),
    ("CTUD", "c(CU := a, PV := 0);", 32766, 32767)])
def test_counters_stop_at_the_limits_of_int(block, call, start, end):
    controller = Controller(main(f"c : {block}; a : BOOL;", call))
    controller["CV"] = start
    controller.diagram({"a": "-_-_-_"}, [])
    assert controller["CV"] == end
