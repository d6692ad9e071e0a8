"""Sequential Function Charts: evolution, as docs/timing.md says, scan by scan.

A column of a line is one scan; `_` is FALSE, `-` is TRUE.
"""

from controller import MS, Controller


def chart(text, declared=""):
    return Controller(f"PROGRAM MAIN VAR go, p, q, out : BOOL; n : INT; {declared} END_VAR\n"
                      f"{text}\nEND_PROGRAM")


TWO_STEPS = """
INITIAL_STEP A: {a} END_STEP
STEP B: {b} END_STEP
TRANSITION FROM A TO B := go; END_TRANSITION
TRANSITION FROM B TO A := NOT go; END_TRANSITION
ACTION count: n := n + 1; END_ACTION
"""


def two_steps(a="", b=""):
    return chart(TWO_STEPS.format(a=a, b=b))


def counts(controller, line):
    """Return n after each scan of a line of `go`."""
    found = []
    for level in line:
        controller.diagram({"go": level}, [])
        found.append(controller["n"])
    return found


# ---------------------------------------------------------------- the first scan and evolution


def test_in_the_first_scan_the_initial_situation_is_taken_and_no_transition_fires():
    controller = two_steps()
    found = controller.diagram({"go": "---"}, ["A.X", "B.X"])
    assert found == {"A.X": "-__", "B.X": "_--"}


def test_before_the_first_scan_no_step_is_active():
    controller = two_steps()
    assert (controller["A.X"], controller["B.X"]) == (False, False)


def test_actions_of_the_initial_step_run_in_the_first_scan():
    assert counts(two_steps(a="count(N);"), "___") == [1, 2, 3]


def test_p1_and_p_of_the_initial_step_run_in_the_first_scan():
    assert counts(two_steps(a="count(P1);"), "___") == [1, 1, 1]
    assert counts(two_steps(a="count(P);"), "___") == [1, 1, 1]


def test_p0_runs_once_in_the_scan_in_which_its_step_is_left():
    assert counts(two_steps(a="count(P0);"), "__--_--") == [0, 0, 1, 1, 1, 2, 2]


def test_one_transition_of_a_chain_fires_in_a_scan():
    controller = chart("""
        INITIAL_STEP A: END_STEP STEP B: END_STEP STEP C: END_STEP
        TRANSITION FROM A TO B := TRUE; END_TRANSITION
        TRANSITION FROM B TO C := TRUE; END_TRANSITION""")
    assert controller.lines(4, ["A.X", "B.X", "C.X"]) == {"A.X": "-___", "B.X": "_-__",
                                                          "C.X": "__--"}


def test_transitions_see_what_the_actions_of_the_scan_before_left():
    controller = chart("""
        INITIAL_STEP A: count(N); END_STEP STEP B: END_STEP
        TRANSITION FROM A TO B := n = 2; END_TRANSITION
        ACTION count: n := n + 1; END_ACTION""")
    assert controller.lines(4, ["B.X"]) == {"B.X": "__--"}


def test_actions_run_in_textual_order_after_all_flags_have_changed():
    controller = chart("""
        INITIAL_STEP A: first(N); second(N); END_STEP
        STEP B: END_STEP
        TRANSITION FROM A TO B := FALSE; END_TRANSITION
        ACTION second: n := n * 10; END_ACTION
        ACTION first: n := n + 1; END_ACTION""")
    assert controller.values(3, "n") == [10, 110, 1110]


def test_conditions_in_il_and_st_and_named_transitions_work():
    controller = chart("""
        INITIAL_STEP A: END_STEP STEP B: END_STEP STEP C: END_STEP
        TRANSITION forward FROM A TO B : LD p
          AND( q
          OR go
          ) END_TRANSITION
        TRANSITION FROM B TO C := p AND NOT q; END_TRANSITION""")
    found = controller.diagram({"p": "----", "q": "_--_", "go": "____"}, ["A.X", "B.X", "C.X"])
    assert found == {"A.X": "-___", "B.X": "_--_", "C.X": "___-"}


def test_an_il_condition_may_return_early():
    controller = chart("""
        INITIAL_STEP A: END_STEP STEP B: END_STEP
        TRANSITION FROM A TO B :
          LD p
          RETC
          LD q
          RET
        END_TRANSITION""")
    assert controller.diagram({"p": "___-", "q": "____"}, ["B.X"]) == {"B.X": "___-"}


def test_a_self_loop_leaves_and_enters_its_step_in_one_scan():
    controller = chart("""
        INITIAL_STEP A: enter(P1); leave(P0); END_STEP
        TRANSITION FROM A TO A := go; END_TRANSITION
        ACTION enter: n := n + 1; END_ACTION
        ACTION leave: n := n + 100; END_ACTION""")
    found = []
    for level in "_-_--":
        controller.diagram({"go": level}, [])
        found.append((controller["n"], controller["A.X"], controller["A.T"] // MS))
    assert found == [(1, True, 0), (102, True, 0), (102, True, 10), (203, True, 0), (304, True, 0)]


# ---------------------------------------------------------------- divergence and convergence

FORK = """
INITIAL_STEP A: END_STEP
STEP B: END_STEP STEP C: END_STEP STEP B2: END_STEP STEP D: END_STEP
TRANSITION FROM A TO (B, C) := go; END_TRANSITION
TRANSITION FROM B TO B2 := p; END_TRANSITION
TRANSITION FROM (B2, C) TO D := q; END_TRANSITION
TRANSITION FROM D TO A := TRUE; END_TRANSITION
"""


def test_a_simultaneous_divergence_activates_all_its_steps_together():
    found = chart(FORK).diagram({"go": "_--"}, ["A.X", "B.X", "C.X"])
    assert found == {"A.X": "-__", "B.X": "_--", "C.X": "_--"}


def test_a_simultaneous_convergence_waits_for_all_its_steps():
    found = chart(FORK).diagram({"go": "_-____", "p": "___-__", "q": "__----"},
                                ["B.X", "B2.X", "C.X", "D.X", "A.X"])
    assert found == {"B.X": "_--___", "B2.X": "___-__", "C.X": "_---__", "D.X": "____-_",
                     "A.X": "-____-"}


SELECTION = """
INITIAL_STEP A: END_STEP STEP L: END_STEP STEP R: END_STEP
TRANSITION {left} FROM A TO L := p; END_TRANSITION
TRANSITION {right} FROM A TO R := q; END_TRANSITION
"""


def selected(left="", right="", p="_-", q="_-"):
    controller = chart(SELECTION.format(left=left, right=right))
    controller.diagram({"p": p, "q": q}, [])
    return "".join(name for name in ("A", "L", "R") if controller[f"{name}.X"])


def test_of_two_true_branches_of_a_selection_the_leftmost_is_taken_alone():
    assert selected() == "L"


def test_a_false_left_branch_leaves_the_way_to_the_right_one():
    assert selected(p="__") == "R"


def test_priorities_come_before_the_order_of_the_text():
    assert selected(right="(PRIORITY := 1)") == "R"
    assert selected(left="(PRIORITY := 2)", right="named (PRIORITY := 1)") == "R"
    assert selected(left="(PRIORITY := 1)", right="(PRIORITY := 1)") == "L"


def test_a_step_consumed_by_a_convergence_cannot_also_take_a_selection():
    controller = chart("""
        INITIAL_STEP A: END_STEP INITIAL_STEP B: END_STEP STEP C: END_STEP STEP D: END_STEP
        TRANSITION FROM (A, B) TO C := p; END_TRANSITION
        TRANSITION FROM B TO D := p; END_TRANSITION""")
    found = controller.diagram({"p": "_-"}, ["A.X", "B.X", "C.X", "D.X"])
    assert found == {"A.X": "-_", "B.X": "-_", "C.X": "_-", "D.X": "__"}


def test_two_selections_that_meet_activate_their_step_once():
    controller = chart("""
        INITIAL_STEP A: END_STEP INITIAL_STEP B: END_STEP STEP C: enter(P1); END_STEP
        TRANSITION FROM A TO C := p; END_TRANSITION
        TRANSITION FROM B TO C := p; END_TRANSITION
        ACTION enter: n := n + 1; END_ACTION""")
    controller.diagram({"p": "_-"}, [])
    assert (controller["n"], controller["C.X"]) == (1, True)


def test_a_step_left_and_entered_by_different_transitions_stays_active():
    controller = chart("""
        INITIAL_STEP A: END_STEP INITIAL_STEP B: END_STEP STEP C: END_STEP
        TRANSITION FROM A TO B := p; END_TRANSITION
        TRANSITION FROM B TO C := p; END_TRANSITION""")
    found = controller.diagram({"p": "_-_"}, ["A.X", "B.X", "C.X"])
    assert found == {"A.X": "-__", "B.X": "---", "C.X": "_--"}


# ---------------------------------------------------------------- the time of a step


def test_the_time_of_a_step_is_zero_in_the_scan_of_activation_and_stays_after_leaving():
    controller = two_steps()
    found = []
    for level in "__---_-":
        controller.diagram({"go": level}, [])
        found.append((controller["A.T"] // MS, controller["B.T"] // MS))
    assert found == [(0, 0), (10, 0), (20, 0), (20, 10), (20, 20), (0, 30), (10, 0)]


def test_a_transition_can_wait_for_the_time_of_its_step():
    controller = chart("""
        INITIAL_STEP A: END_STEP STEP B: END_STEP
        TRANSITION FROM A TO B := A.T >= T#30ms; END_TRANSITION""")
    assert controller.lines(6, ["B.X"]) == {"B.X": "___---"}


def test_il_conditions_can_read_the_time_of_a_step():
    controller = chart("""
        INITIAL_STEP A: END_STEP STEP B: END_STEP
        TRANSITION FROM A TO B : LD A.T
          GE T#30ms END_TRANSITION""")
    assert controller.lines(6, ["B.X"]) == {"B.X": "___---"}


# ---------------------------------------------------------------- actions


def test_a_p_action_on_two_steps_in_a_row_runs_in_each():
    assert counts(two_steps(a="count(P);", b="count(P);"), "_-_-") == [1, 2, 3, 4]
    assert counts(two_steps(a="count(P1);", b="count(P1);"), "_-_-") == [1, 2, 3, 4]


def test_an_action_commanded_in_several_ways_runs_once_in_a_scan():
    assert counts(two_steps(a="count(N); count(P1);", b="count(N); count(P0);"), "__--_") == [
        1, 2, 3, 4, 5]


def test_an_action_of_two_active_steps_runs_once_in_a_scan():
    controller = chart("""
        INITIAL_STEP A: count(N); END_STEP INITIAL_STEP B: count(N); END_STEP
        ACTION count: n := n + 1; END_ACTION""")
    assert controller.values(3, "n") == [1, 2, 3]


def test_an_action_block_without_qualifier_means_n():
    assert counts(two_steps(b="count;"), "_--_") == [0, 1, 2, 2]
    assert counts(two_steps(b="count();"), "_--_") == [0, 1, 2, 2]


def test_a_boolean_variable_is_an_action():
    found = two_steps(b="out(N);").diagram({"go": "__--__"}, ["out"])
    assert found == {"out": "__--__"}


def test_a_located_boolean_variable_is_an_action():
    controller = chart("INITIAL_STEP A: lamp(N); END_STEP", "lamp AT %QX0.3 : BOOL;")
    assert controller.scan()["%QX0.3"] is True


def test_actions_in_il_run_like_those_in_st():
    controller = chart("""
        INITIAL_STEP A: count(N); END_STEP
        ACTION count:
          LD n
          ADD 1
          ST n
        END_ACTION""")
    assert controller.values(3, "n") == [1, 2, 3]


def test_return_in_an_action_leaves_the_action_only():
    controller = chart("""
        INITIAL_STEP A: first(N); second(N); END_STEP
        ACTION first: RETURN; n := 100; END_ACTION
        ACTION second: n := n + 1; END_ACTION""")
    assert controller.values(2, "n") == [1, 2]


def test_charts_in_function_blocks_run_for_each_instance():
    text = ("FUNCTION_BLOCK Toggle VAR_INPUT go : BOOL; END_VAR VAR_OUTPUT q : BOOL; END_VAR\n"
            "INITIAL_STEP A: END_STEP STEP B: q(N); END_STEP\n"
            "TRANSITION FROM A TO B := go; END_TRANSITION\n"
            "TRANSITION FROM B TO A := go; END_TRANSITION END_FUNCTION_BLOCK\n"
            "PROGRAM MAIN VAR f, g : Toggle; a, b : BOOL; END_VAR\n"
            "f(go := a); g(go := b); END_PROGRAM")
    found = Controller(text).diagram({"a": "_--_", "b": "_-__"}, ["f.q", "g.q"])
    assert found == {"f.q": "_-__", "g.q": "_---"}


def test_a_chart_of_a_thousand_steps_in_a_ring_compiles_and_runs():
    ring = "".join(f"{'INITIAL_' * (k == 0)}STEP s{k}: out(N); END_STEP\n"
                   f"TRANSITION FROM s{k} TO s{(k + 1) % 1000} := TRUE; END_TRANSITION\n"
                   for k in range(1000))
    controller = chart(ring).scan(4)
    assert (controller["s3.X"], controller["s2.X"]) == (True, False)


def test_a_step_that_a_thousand_transitions_lead_to_compiles():
    star = "".join(f"TRANSITION FROM A TO B := n = {k}; END_TRANSITION\n" for k in range(1000))
    controller = chart("INITIAL_STEP A: END_STEP STEP B: END_STEP\n" + star)
    assert controller.lines(3, ["B.X"]) == {"B.X": "_--"}
