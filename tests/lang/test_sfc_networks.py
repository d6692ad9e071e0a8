"""Charts as nets: named conditions, several networks, instances, what is unsafe (2.6.3, 2.6.5)."""

import pytest
from controller import Controller, findings

from plcemu.lang.sfc_net import FIRING_LIMIT

DECLARED = "PROGRAM MAIN VAR go, p, q, out : BOOL; n : INT; END_VAR\n"


def chart(text):
    return Controller(f"{DECLARED}{text}\nEND_PROGRAM")


def warnings(text):
    found = findings(f"{DECLARED}{text}\nEND_PROGRAM")
    return [f[-5:] for f in found if "P0070" not in f]


STEPS = "INITIAL_STEP A: END_STEP STEP B: END_STEP STEP C: END_STEP STEP D: END_STEP\n"


def arc(sources, targets, condition="go"):
    return f"TRANSITION FROM {sources} TO {targets} := {condition}; END_TRANSITION\n"


# ---------------------------------------------------------------- conditions by name


@pytest.mark.parametrize("condition", [
    "TRANSITION ready := p AND q; END_TRANSITION",
    "TRANSITION ready : LD p\nAND q\nEND_TRANSITION",
])
@pytest.mark.parametrize("use", [
    "TRANSITION ready FROM A TO B END_TRANSITION",
    "TRANSITION READY FROM A TO B; END_TRANSITION",
    "TRANSITION FROM A TO B := ready; END_TRANSITION",
    "TRANSITION other (PRIORITY := 1) FROM A TO B := Ready; END_TRANSITION",
])
def test_a_condition_may_be_declared_elsewhere_under_a_name(condition, use):
    for text in (condition + "\n" + use, use + "\n" + condition):
        controller = chart("INITIAL_STEP A: END_STEP STEP B: END_STEP\n" + text)
        found = controller.diagram({"p": "_-_--", "q": "__---"}, ["B.X"])
        assert found == {"B.X": "___--"}


def test_several_transitions_may_take_one_condition():
    controller = chart(STEPS + "TRANSITION t := go; END_TRANSITION\n" + arc("A", "B", "t")
                       + arc("B", "C", "t") + arc("C", "D", "t"))
    assert controller.diagram({"go": "_-_--"}, ["D.X"]) == {"D.X": "____-"}


def test_a_variable_hides_a_condition_of_its_name():
    controller = chart(STEPS + "TRANSITION p := FALSE; END_TRANSITION\n" + arc("A", "B", "p"))
    assert controller.diagram({"p": "_--"}, ["B.X"]) == {"B.X": "_--"}


# ---------------------------------------------------------------- several networks and instances


def test_two_networks_of_one_pou_evolve_independently():
    controller = chart(STEPS.replace("STEP C", "INITIAL_STEP C") + arc("A", "B", "p")
                       + arc("C", "D", "q") + arc("D", "C", "NOT q"))
    found = controller.diagram({"p": "_--__", "q": "_-_-_"}, ["A.X", "B.X", "C.X", "D.X"])
    assert found == {"A.X": "-____", "B.X": "_----", "C.X": "-_-_-", "D.X": "_-_-_"}


def test_two_instances_of_a_block_with_a_chart_have_steps_times_and_actions_of_their_own():
    controller = Controller("""
        FUNCTION_BLOCK Pulse VAR_INPUT go : BOOL; END_VAR VAR_OUTPUT q : BOOL; n : INT; END_VAR
        INITIAL_STEP idle: END_STEP STEP busy: q(N); count(P1); END_STEP
        TRANSITION FROM idle TO busy := go; END_TRANSITION
        TRANSITION FROM busy TO idle := busy.T >= T#20ms AND NOT go; END_TRANSITION
        ACTION count: n := n + 1; END_ACTION END_FUNCTION_BLOCK
        PROGRAM MAIN VAR one, two : Pulse; a, b : BOOL; END_VAR
        one(go := a); two(go := b); END_PROGRAM""")
    found = controller.diagram({"a": "_-___-__", "b": "___-____"}, ["one.q", "two.q"])
    assert found == {"one.q": "_--__--_", "two.q": "___--___"}
    assert (controller["one.n"], controller["two.n"]) == (2, 1)


def test_a_step_in_a_block_keeps_its_time_while_the_block_is_not_called():
    controller = Controller("""
        FUNCTION_BLOCK F VAR_OUTPUT t : TIME; END_VAR
        INITIAL_STEP A: read(N); END_STEP ACTION read: t := A.T; END_ACTION END_FUNCTION_BLOCK
        PROGRAM MAIN VAR f : F; call : BOOL; END_VAR IF call THEN f(); END_IF; END_PROGRAM""")
    controller.diagram({"call": "-___-"}, [])
    assert controller["f.t"] == 40_000_000


def test_steps_are_known_in_every_text_of_the_pou():
    controller = chart("""
        INITIAL_STEP A: see(N); END_STEP STEP B: see(N); END_STEP
        TRANSITION FROM A TO B : LD A.X
          AND( A.T
          GE T#20ms
          )
        END_TRANSITION
        ACTION see: out := B.X AND NOT A.X; IF B.X THEN n := n + 1; END_IF; END_ACTION""")
    assert controller.lines(4, ["out"]) == {"out": "__--"}


# ---------------------------------------------------------------- selection


def test_of_three_true_branches_only_the_one_with_the_best_priority_fires():
    text = STEPS + "".join(
        f"TRANSITION (PRIORITY := {rank}) FROM A TO {step} := go; END_TRANSITION\n"
        for rank, step in ((3, "B"), (1, "C"), (2, "D")))
    found = chart(text).diagram({"go": "_-"}, ["A.X", "B.X", "C.X", "D.X"])
    assert found == {"A.X": "-_", "B.X": "__", "C.X": "_-", "D.X": "__"}


def test_transitions_without_priority_come_after_those_with_one():
    text = STEPS + arc("A", "B") + "TRANSITION (PRIORITY := 9) FROM A TO C := go; END_TRANSITION\n"
    assert chart(text).diagram({"go": "_-"}, ["B.X", "C.X"]) == {"B.X": "__", "C.X": "_-"}


# ---------------------------------------------------------------- soundness

FORK = arc("A", "(B, C)")


@pytest.mark.parametrize(("arcs", "codes"), [
    (FORK + arc("(B, C)", "D") + arc("D", "A"), []),
    (arc("A", "B") + arc("A", "C") + arc("B", "D") + arc("C", "D") + arc("D", "A"), []),
    (arc("A", "B") + arc("B", "C") + arc("C", "D") + arc("D", "B"), []),
    (arc("A", "B") + arc("A", "C") + arc("(B, C)", "D"), ["P0057"]),
    (FORK + arc("B", "D") + arc("C", "D"), ["P0056"]),
    (FORK + arc("B", "A") + arc("C", "D"), ["P0056"]),
    (FORK + arc("B", "D") + arc("(B, C)", "A"), []),
    (arc("A", "(B, C)") + arc("B", "C") + arc("C", "D"), ["P0056"]),
    (arc("A", "B") + arc("B", "A"), ["P0055", "P0055"]),
    (arc("A", "B") + arc("(C, D)", "A"), ["P0055", "P0055"]),
])
def test_unsafe_and_unreachable_networks_are_told(arcs, codes):
    assert warnings(STEPS + arcs) == codes


def test_an_unsafe_step_is_named_in_the_users_spelling_and_stays_active_once():
    steps = STEPS.replace("D:", "Done:")
    text = f"{DECLARED}{steps}{FORK}{arc('B', 'Done')}{arc('C', 'Done', 'p')}"
    controller = Controller(text + "END_PROGRAM")
    message = str(next(d for d in controller.resource.program.warnings if d.code == "P0056"))
    assert "activate step Done while it is active" in message
    found = controller.diagram({"go": "_--_", "p": "___-"}, ["Done.X", "C.X"])
    assert found == {"Done.X": "__--", "C.X": "_--_"}


def test_a_chart_beyond_the_limit_of_exploration_compiles_without_a_verdict():
    width, length = 8, 6
    names = [[f"s{k}_{j}" for j in range(length)] for k in range(width)]
    steps = "INITIAL_STEP A: END_STEP "
    steps += " ".join(f"STEP {n}: END_STEP" for row in names for n in row)
    arcs = arc("A", "(" + ", ".join(row[0] for row in names) + ")")
    arcs += "".join(arc(row[j], row[j + 1]) for row in names for j in range(length - 1))
    arcs += arc("(" + ", ".join(row[-1] for row in names) + ")", "A")
    assert length ** width > FIRING_LIMIT
    assert warnings(steps + "\n" + arcs) == []
