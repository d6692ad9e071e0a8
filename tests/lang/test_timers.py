"""TON, TOF and TP follow the standard's timing diagrams scan by scan (IEC 61131-3, figure 15).

One column is one scan of 10 ms; Q and IN are lines of `_` and `-`, ET is in ms.
"""

import pytest
from controller import MS, Controller, main


def timing(block, line, pt_ms, call="t(IN := in, PT := pt);", change=()):
    """Return the line of Q and the values of ET for a line of IN; `change` sets PT at scans."""
    text = main(f"t : {block}; in : BOOL; pt : TIME; n : INT;", call)
    controller = Controller(text)
    controller["pt"] = pt_ms * MS
    q, et = "", []
    for n, level in enumerate(line):
        controller["MAIN.pt"] = dict(change).get(n, controller["MAIN.pt"] // MS) * MS
        q += controller.diagram({"MAIN.in": level}, ["t.Q"])["t.Q"]
        et.append(controller["t.ET"] // MS)
    return q, et


@pytest.mark.parametrize(("line", "pt", "q", "et"), [
    ("_----__", 30, "____-__", [0, 0, 10, 20, 30, 0, 0]),
    ("_-----_", 30, "____--_", [0, 0, 10, 20, 30, 30, 0]),
    ("---___--", 30, "________", [0, 10, 20, 0, 0, 0, 0, 10]),
    ("--_----", 20, "_____--", [0, 10, 0, 0, 10, 20, 20]),
    ("_--_", 0, "_--_", [0, 0, 0, 0]),
    ("----", 15, "__--", [0, 10, 15, 15]),
    ("--_--", 10, "_-__-", [0, 10, 0, 0, 10]),
])
def test_ton_is_on_when_in_has_been_true_for_pt(line, pt, q, et):
    assert timing("TON", line, pt) == (q, et)


@pytest.mark.parametrize(("line", "pt", "q", "et"), [
    ("____", 20, "____", [0, 0, 0, 0]),
    ("-____", 20, "---__", [0, 0, 10, 20, 20]),
    ("--___-_", 20, "----_--", [0, 0, 0, 10, 20, 0, 0]),
    ("-_-__", 20, "-----", [0, 0, 0, 0, 10]),
    ("-__-___", 10, "--_--__", [0, 0, 10, 0, 0, 10, 10]),
    ("--__", 0, "--__", [0, 0, 0, 0]),
    ("-___", 15, "---_", [0, 0, 10, 15]),
])
def test_tof_stays_on_for_pt_after_in_falls(line, pt, q, et):
    assert timing("TOF", line, pt) == (q, et)


@pytest.mark.parametrize(("line", "pt", "q", "et"), [
    ("_-____", 30, "_---__", [0, 0, 10, 20, 0, 0]),
    ("------_", 30, "---____", [0, 10, 20, 30, 30, 30, 0]),
    ("-_-_-_", 30, "---_--", [0, 10, 20, 0, 0, 10]),
    ("-_-___", 20, "--____", [0, 10, 20, 0, 0, 0]),
    ("-_____-___", 20, "--____--__", [0, 10, 0, 0, 0, 0, 0, 10, 0, 0]),
    ("_-_", 0, "___", [0, 0, 0]),
    ("-___", 15, "--__", [0, 10, 0, 0]),
])
def test_tp_gives_a_pulse_of_pt_that_nothing_shortens_or_prolongs(line, pt, q, et):
    assert timing("TP", line, pt) == (q, et)


@pytest.mark.parametrize(("block", "line", "change", "q", "et"), [
    ("TON", "------", {2: 20}, "__----", [0, 10, 20, 20, 20, 20]),
    ("TON", "------", {2: 10}, "__----", [0, 10, 10, 10, 10, 10]),
    ("TON", "------", {2: 50}, "_____-", [0, 10, 20, 30, 40, 50]),
    ("TON", "------", {4: 90}, "___---", [0, 10, 20, 30, 30, 30]),
    ("TOF", "-______", {3: 20}, "---____", [0, 0, 10, 20, 20, 20, 20]),
    ("TOF", "-______", {3: 40}, "-----__", [0, 0, 10, 20, 30, 40, 40]),
    ("TP", "------", {2: 10}, "--____", [0, 10, 10, 10, 10, 10]),
    ("TP", "------", {2: 50}, "-----_", [0, 10, 20, 30, 40, 50]),
    ("TON", "------", {2: 0}, "__----", [0, 10, 0, 0, 0, 0]),
    ("TON", "-----_--", {0: 0, 1: 50, 6: -10}, "-----_--", [0, 0, 0, 0, 0, 0, -10, -10]),
    ("TOF", "-______", {3: 0}, "---____", [0, 0, 10, 0, 0, 0, 0]),
    ("TOF", "-__-_", {0: -10, 2: 50}, "-__--", [0, -10, -10, 0, 0]),
])
def test_pt_may_change_while_a_timer_runs(block, line, change, q, et):
    assert timing(block, line, 30, change=change.items()) == (q, et)


@pytest.mark.parametrize(("block", "line", "q", "et"), [
    ("TON", "-" * 10, "______----", [0, 0, 0, 30, 30, 30, 40, 40, 40, 40]),
    ("TOF", "-_________", "---------_", [0, 0, 0, 0, 0, 0, 30, 30, 30, 40]),
    ("TP", "-" * 10, "------____", [0, 0, 0, 30, 30, 30, 40, 40, 40, 40]),
])
def test_a_timer_called_every_third_scan_still_measures_time(block, line, q, et):
    call = "IF n MOD 3 = 0 THEN t(IN := in, PT := pt); END_IF; n := n + 1;"
    assert timing(block, line, 40, call) == (q, et)


def test_a_timer_that_is_not_called_does_not_move_its_outputs():
    call = "IF n < 2 THEN t(IN := in, PT := pt); END_IF; n := n + 1;"
    assert timing("TON", "------", 30, call) == ("______", [0, 10, 10, 10, 10, 10])


def test_timers_stop_at_their_preset_so_that_states_recur():
    controller = Controller(main("t : TON;", "t(IN := TRUE, PT := T#25ms);")).scan(4)
    image = controller.resource.snapshot()
    assert controller.scan(50).resource.snapshot() == image


def test_a_timer_measures_the_time_of_the_scans_not_their_number():
    controller = Controller(main("t : TON;", "t(IN := TRUE, PT := T#1s);"))
    for t_ns, q in ((0, False), (999 * MS, False), (1000 * MS, True)):
        controller.resource.scan(t_ns)
        assert controller["Q"] is q


def test_timers_nest_in_function_blocks_of_the_user():
    text = ("FUNCTION_BLOCK Blink VAR_INPUT half : TIME; END_VAR VAR_OUTPUT lamp : BOOL; END_VAR\n"
            "VAR t : TON; END_VAR t(IN := NOT t.Q, PT := half);\n"
            "IF t.Q THEN lamp := NOT lamp; END_IF;\n"
            "END_FUNCTION_BLOCK\n" + main("b : Blink;", "b(half := T#20ms);"))
    assert Controller(text).lines(10, ["lamp"]) == {"lamp": "__----____"}
