"""Signal Interpreted Petri Nets: the firing rules, their bounds, and nets as POUs among others."""

import pytest
from controller import Controller, main
from systems import system_of

from plcemu.lang.compile import compile_program
from plcemu.lang.lower_sipn import ROUNDS

DECLARED = "i, k, x, y : BOOL;"


def net(places, transitions):
    """A program MAIN; places as `*A x=1`, transitions as `A -> B,C if cond`, one a line."""
    body = []
    for row in places.strip().split("\n"):
        name, *given = row.split()
        values = " ".join(f"{each.replace('=', ' := ')};" for each in given)
        keyword = "INITIAL_PLACE" if name.startswith("*") else "PLACE"
        body.append(f"{keyword} {name.lstrip('*')}: {values} END_PLACE")
    for n, row in enumerate(transitions.strip().split("\n")):
        arcs, _, condition = row.partition(" if ")
        before, _, after = arcs.partition("->")
        body.append(f"TRANSITION T{n + 1} FROM ({before}) TO ({after}) := {condition}; "
                    "END_TRANSITION")
    return main(DECLARED, "\n".join(body))


def marked(controller, names):
    return "".join(name for name in names if controller[name])


CHAIN = net("*A x=0\nB x=1\nC x=1", "A -> B if i\nB -> C if i\nC -> A if NOT i")
RING = net("*A x=0\nB x=1", "A -> B if i\nB -> A if i")


def test_the_marking_before_the_first_scan_is_the_initial_one():
    assert marked(Controller(CHAIN), "ABC") == "A"


def test_one_scan_fires_until_the_marking_is_stable():
    controller = Controller(CHAIN)
    controller["i"] = True
    assert marked(controller.scan(), "ABC") == "C"
    assert [controller[name] for name in ("T1", "T2", "T3", "eoc")] == [True, True, False, True]


def test_transitions_without_a_common_place_fire_together():
    controller = Controller(net("*A\n*B\nC x=0\nD", "A -> C if i\nB -> D if i"))
    controller["i"] = True
    assert marked(controller.scan(), "ABCD") == "CD"


def test_a_marked_place_behind_a_transition_keeps_it_from_firing():
    controller = Controller(net("*A x=0\n*B", "A -> B if i\nB -> A if k"))
    controller["i"] = True
    assert marked(controller.scan(), "AB") == "AB"
    assert controller["eoc"] is True


def test_a_place_before_and_behind_a_transition_is_asked_for_and_stays_marked():
    controller = Controller(net("*A x=0\n*B\nC", "A,B -> B,C if i"))
    controller["i"] = True
    assert marked(controller.scan(), "ABC") == "BC"


def test_of_two_transitions_in_conflict_the_first_in_the_text_fires_and_the_flag_tells():
    controller = Controller(net("*A x=0\nB\nC", "A -> B if i\nA -> C if i OR k"))
    controller["i"] = True
    assert marked(controller.scan(), "ABC") == "B"
    assert controller["conflict"] is True
    assert controller.scan()["conflict"] is False


def test_transitions_may_have_no_place_before_or_behind_them():
    controller = Controller(net("*A x=0\nB", " -> B if i\nA ->  if k"))
    controller["i"] = controller["k"] = True
    assert marked(controller.scan(), "AB") == "B"


# ---------------------------------------------------------------- nets that are never stable


def test_a_net_that_never_stabilises_ends_its_scan_with_eoc_false_and_old_outputs():
    controller = Controller(RING)
    controller.scan()
    controller["i"] = True
    for _ in range(5):
        controller.scan()
        assert (controller["eoc"], controller["x"]) == (False, False)
    assert controller.resource.state.value == "RUN"


def test_while_the_net_is_not_stable_the_inputs_stand_still():
    controller = Controller(RING)
    controller["i"] = True
    controller.scan()
    controller["i"] = False
    assert controller.scan(3)["eoc"] is False


def test_a_long_way_to_the_stable_marking_goes_on_in_the_next_scan_with_the_same_inputs():
    length = ROUNDS + 20
    places = "\n".join(["*P0 x=0", *(f"P{n + 1} x=1" for n in range(length))])
    ways = "\n".join(f"P{n} -> P{n + 1} if i" for n in range(length))
    controller = Controller(net(places, ways))
    controller["i"] = True
    controller.scan()
    assert (controller[f"P{ROUNDS}"], controller["eoc"]) == (True, False)
    controller["i"] = False
    controller.scan()
    assert (controller[f"P{length}"], controller["eoc"], controller["x"]) == (True, True, True)


# ---------------------------------------------------------------- single firing


def test_with_single_firing_a_scan_takes_the_inputs_or_fires_once():
    controller = Controller(compile_program(CHAIN, single_firing=True))
    controller["i"] = True
    shown = [(marked(controller.scan(), "ABC"), controller["eoc"]) for _ in range(4)]
    assert shown == [("A", False), ("B", False), ("C", True), ("C", True)]


def test_with_single_firing_inputs_that_change_meanwhile_count_only_when_stable():
    controller = Controller(compile_program(CHAIN, single_firing=True))
    controller["i"] = True
    controller.scan()
    controller["i"] = False
    assert [marked(controller.scan(), "ABC") for _ in range(4)] == ["B", "C", "C", "A"]


def test_with_single_firing_a_conflict_shows_before_it_is_decided():
    text = net("*A x=0\nB\nC", "A -> B if i\nA -> C if i")
    controller = Controller(compile_program(text, single_firing=True))
    controller["i"] = True
    controller.scan()
    assert (marked(controller, "ABC"), controller["conflict"]) == ("A", True)


def test_the_configuration_chooses_single_firing(tmp_path):
    system = system_of(tmp_path, "sipn_single_firing: true", CHAIN)
    system.exchange.port("test")
    memory = system.resource.memory
    offset, _ = memory.place(memory.tags.find("i"))
    memory.block[offset] = 1
    system.cycle.lap()
    assert memory.read(memory.tags.find("A")) is True


# ---------------------------------------------------------------- outputs


def test_an_output_without_a_value_keeps_the_one_it_had_and_the_flag_tells():
    controller = Controller(net("*A x=1\nB y=1", "A -> B if i\nB -> A if NOT i"))
    controller.scan()
    controller["i"] = True
    controller.scan()
    assert [controller[n] for n in ("x", "y", "undefined")] == [True, True, True]


def test_an_output_that_is_to_be_0_and_1_is_0_and_the_flag_tells():
    controller = Controller(net("*A x=1\n*B x=0", "A -> A if i"))
    controller.scan()
    assert [controller[n] for n in ("x", "contradictory", "undefined")] == [False, True, False]


# ---------------------------------------------------------------- nets among other POUs


def test_a_net_is_a_function_block_that_other_languages_call():
    block = CHAIN.replace("PROGRAM MAIN", "FUNCTION_BLOCK WALK").replace(
        "VAR\ni, k, x, y : BOOL;\n",
        "VAR_INPUT i : BOOL; END_VAR VAR_OUTPUT x : BOOL; END_VAR VAR\n"
    ).replace("END_PROGRAM", "END_FUNCTION_BLOCK")
    text = block + main("one, two : WALK; go, on : BOOL;",
                        "one(i := go, x => on);\ntwo(i := FALSE);")
    controller = Controller(text)
    controller["go"] = True
    controller.scan()
    assert [controller[n] for n in ("on", "one.C", "two.A")] == [True, True, True]


def test_conditions_read_any_signal_that_the_program_has():
    text = main("level AT %IW0 : INT; x AT %QX0.0 : BOOL; t : TON;",
                "INITIAL_PLACE A: x := 0; END_PLACE PLACE B: x := 1; END_PLACE\n"
                "TRANSITION T1 FROM A TO B := level > 10 AND MAX(level, 5) <> 20; END_TRANSITION\n"
                "TRANSITION T2 FROM B TO A := level <= 10; END_TRANSITION")
    controller = Controller(text)
    levels = [5, 11, 20, 10, 20, 21]
    shown = []
    for level in levels:
        controller["level"] = level
        shown.append(controller.scan()["x"])
    assert shown == [False, True, True, False, False, True]


def test_the_words_of_nets_are_names_elsewhere():
    controller = Controller(main("place, initial_place : INT;",
                                 "place := 3;\ninitial_place := place;"))
    assert controller.scan()["initial_place"] == 3


def test_a_function_has_no_places():
    text = ("FUNCTION f : INT\nINITIAL_PLACE A: END_PLACE\nTRANSITION T FROM A TO A := TRUE; "
            "END_TRANSITION\nEND_FUNCTION\n" + main("x : INT;", "x := f();"))
    with pytest.raises(Exception, match="2:1: P0010 a FUNCTION has no memory, so it has no places"):
        compile_program(text)


def test_what_marking_a_net_has_is_kept_in_a_snapshot():
    controller = Controller(CHAIN)
    controller["i"] = True
    image = controller.scan().resource.snapshot()
    controller["i"] = False
    controller.scan()
    controller.resource.restore(image)
    assert marked(controller, "ABC") == "C"
