"""CONFIGURATION, RESOURCE, TASK, program instances and their connections (IEC 61131-3, 2.7)."""

import pytest
from controller import MS, Controller, findings

from plcemu.ir.program import Event, Task
from plcemu.lang.compile import compile_program

PROGRAM = """
TYPE Pair : STRUCT a, b : INT; END_STRUCT; END_TYPE
PROGRAM MAIN
VAR_INPUT a : INT := 5; on : BOOL; pair : Pair; END_VAR
VAR_OUTPUT twice : INT; q : BOOL; END_VAR
VAR n : INT; f : TON; END_VAR
n := n + 1; twice := a * 2; q := on; pair.b := a; f(IN := on, PT := T#1s);
END_PROGRAM
"""
GLOBALS = ("a : INT := 7; r, s : INT; trigger : BOOL; pair : Pair; field AT %IW0 : INT;\n"
           "lamp AT %MW1 : INT; out AT %MW5 : INT;")


def text(inside, variables=GLOBALS):
    return (f"{PROGRAM}CONFIGURATION C VAR_GLOBAL {variables} END_VAR\n"
            f"RESOURCE R ON CPU\n{inside}\nEND_RESOURCE END_CONFIGURATION")


def codes(inside):
    return [f[-5:] for f in findings(text(inside))]


# ---------------------------------------------------------------- connections


@pytest.mark.parametrize(("connection", "tag", "value"), [
    ("a := a, twice => r", "r", 14), ("a := 21, twice => out", "out", 42),
    ("a := R.a, twice => C.r", "r", 14), ("a := field, twice => lamp", "lamp", 0),
    ("twice => r", "r", 10), ("on := TRUE, q => %QX0.3", "%QX0.3", True),
    ("a := pair.a, twice => pair.b", "pair.b", 0), ("pair := pair, twice => r", "r", 10),
    ("on := NOT trigger, q => %QX0.3", "%QX0.3", True),
])
def test_inputs_come_before_and_outputs_go_after_the_program(connection, tag, value):
    controller = Controller(text(f"PROGRAM one : MAIN({connection});")).scan()
    assert controller[tag] == value


def test_connections_follow_their_sources_at_every_run():
    controller = Controller(text("PROGRAM one : MAIN(a := field, twice => lamp);"))
    found = []
    for value in (3, -8, 0):
        controller["field"] = value
        found.append(controller.scan()["one.twice"])
    assert found == [6, -16, 0]


def test_two_instances_have_variables_and_connections_of_their_own():
    controller = Controller(text("PROGRAM one : MAIN(a := 1, twice => r);\n"
                                 "PROGRAM two : MAIN(a := r, twice => s);")).scan()
    assert [controller[t] for t in ("one.a", "one.twice", "two.a", "two.twice", "s")] \
        == [1, 2, 2, 4, 4]


def test_an_input_without_a_connection_keeps_its_initial_value():
    controller = Controller(text("PROGRAM one : MAIN(); PROGRAM two : MAIN;")).scan()
    assert (controller["one.a"], controller["two.a"]) == (5, 5)


def test_the_tags_of_an_instance_begin_with_its_name():
    names = [s.tag.name for s in compile_program(text("PROGRAM one : MAIN;")).layout.slots]
    assert {"one.n", "one.f.Q", "one.pair.b", "r", "out"} <= set(names)


@pytest.mark.parametrize(("connection", "code"), [
    ("b := a", "P0026"), ("twice := a", "P0026"), ("a => r", "P0026"), ("n := 5", "P0026"),
    ("a := nowhere", "P0020"), ("twice => nowhere", "P0020"), ("twice => 5", "P0024"),
    ("a := trigger", "P0023"), ("twice => trigger", "P0023"), ("a := n", "P0020"),
    ("twice => %QX0.0", "P0023"), ("f WITH t", "P0090"),
])
def test_a_mistake_in_a_connection_has_its_code(connection, code):
    assert codes(f"TASK t(PRIORITY := 1); PROGRAM one WITH t : MAIN({connection});") == [code]


def test_what_connections_write_counts_as_written():
    variables = "a : INT; lamp AT %QW0 : INT;"
    tasks = ("TASK t(PRIORITY := 1); TASK u(PRIORITY := 2);\n"
             "PROGRAM one WITH t : MAIN(twice => lamp); PROGRAM two WITH u : MAIN(twice => {});")
    assert [f[-5:] for f in findings(text("PROGRAM one : MAIN;", variables))] == ["P0071"]
    assert findings(text(tasks.format("a"), variables)) == []
    assert [f[-5:] for f in findings(text(tasks.format("lamp"), variables))] == ["P0074"]


# ---------------------------------------------------------------- tasks and instances


def test_intervals_and_priorities_of_tasks_are_kept():
    tasks = compile_program(text("TASK slow(INTERVAL := T#100ms, PRIORITY := 2);\n"
                                 "TASK fast(INTERVAL := T#20ms, PRIORITY := 1);\n"
                                 "PROGRAM one WITH slow : MAIN; PROGRAM two WITH fast : MAIN;\n"
                                 "PROGRAM three : MAIN;")).tasks
    assert tasks == (Task("slow", 100 * MS, 2, 0, ("one",)), Task("fast", 20 * MS, 1, 0, ("two",)),
                     Task("main", 0, 65536, 0, ("three",)))


def test_each_task_runs_its_programs_at_its_interval():
    controller = Controller(text("TASK slow(INTERVAL := T#30ms); TASK fast(INTERVAL := T#10ms);\n"
                                 "PROGRAM one WITH slow : MAIN; PROGRAM two WITH fast : MAIN;"))
    controller.scan(7)
    assert (controller["one.n"], controller["two.n"]) == (3, 7)


def test_more_urgent_tasks_run_first_whatever_their_order_in_the_text():
    controller = Controller(text("TASK late(PRIORITY := 5); TASK early(PRIORITY := 1);\n"
                                 "PROGRAM one WITH late : MAIN(a := r);\n"
                                 "PROGRAM two WITH early : MAIN(a := 4, twice => r);")).scan()
    assert controller["one.twice"] == 16


def test_an_interval_may_be_a_global_constant():
    found = compile_program(
        f"VAR_GLOBAL CONSTANT period : TIME := T#40ms; END_VAR\n"
        f"{text('TASK t(INTERVAL := period); PROGRAM one WITH t : MAIN;')}").tasks
    assert found[0].interval_ns == 40 * MS


@pytest.mark.parametrize("trigger", ["trigger", "R.trigger", "%IX0.0", "C.trigger"])
def test_single_names_a_global_variable_or_an_address(trigger):
    task = compile_program(text(f"TASK t(SINGLE := {trigger}, PRIORITY := 1);\n"
                                "PROGRAM one WITH t : MAIN;")).tasks[0]
    assert isinstance(task.event, Event)


@pytest.mark.parametrize(("inside", "found"), [
    ("TASK t(SINGLE := 1); PROGRAM p WITH t : MAIN;", ["P0027"]),
    ("TASK t(SINGLE := a); PROGRAM p WITH t : MAIN;", ["P0023"]),
    ("TASK t(SINGLE := nowhere); PROGRAM p WITH t : MAIN;", ["P0020"]),
    ("TASK t(INTERVAL := 5); PROGRAM p WITH t : MAIN;", ["P0025"]),
    ("TASK t(INTERVAL := a); PROGRAM p WITH t : MAIN;", ["P0027"]),
    ("TASK t(PRIORITY := T#1s); PROGRAM p WITH t : MAIN;", ["P0025"]),
    ("TASK t(PRIO := 1); PROGRAM p WITH t : MAIN;", ["P0010"]),
    ("TASK t(PRIORITY := 1); PROGRAM p WITH u : MAIN; PROGRAM q WITH t : MAIN;", ["P0020"]),
    ("TASK t(PRIORITY := 1); TASK T(PRIORITY := 1); PROGRAM p WITH t : MAIN;", ["P0021"]),
    ("PROGRAM p : MAIM;", ["P0022"]), ("PROGRAM p : MAIN; PROGRAM P : MAIN;", ["P0021"]),
    ("TASK idle(PRIORITY := 1); PROGRAM p : MAIN;", ["P0058"]),
    ("PROGRAM p : MAIN; END_RESOURCE VAR_CONFIG R.p.n : INT := 5; END_VAR RESOURCE S ON CPU",
     ["P0090"]),
])
def test_a_mistake_in_a_resource_has_its_code(inside, found):
    assert [c for c in codes(inside) if (c, "RESOURCE" in inside) != ("P0090", False)] == found


def test_several_resources_run_as_one_with_a_warning():
    inside = ("TASK t(INTERVAL := T#10ms); PROGRAM one WITH t : MAIN; END_RESOURCE\n"
              "RESOURCE S ON CPU TASK t(INTERVAL := T#20ms); PROGRAM two WITH t : MAIN;")
    controller = Controller(text(inside)).scan(4)
    assert (controller["one.n"], controller["two.n"]) == (4, 2)
    assert codes(inside) == ["P0090"]


def test_a_task_called_as_the_default_one_stands_beside_it():
    controller = Controller(text("TASK main(INTERVAL := T#20ms); PROGRAM one WITH main : MAIN; "
                                 "PROGRAM two : MAIN;")).scan(4)
    assert (controller["one.n"], controller["two.n"]) == (2, 4)


def test_a_second_configuration_is_told():
    assert [f[-5:] for f in findings(text("PROGRAM p : MAIN;")
                                     + "\nCONFIGURATION D PROGRAM q : MAIN; END_CONFIGURATION")] \
        == ["P0090"]


def test_access_paths_are_read_over():
    controller = Controller(
        PROGRAM + "CONFIGURATION C RESOURCE R ON CPU PROGRAM one : MAIN; END_RESOURCE\n"
        "VAR_ACCESS path : R.one.a : INT READ_WRITE; other : R.%QX0.0 : BOOL; END_VAR\n"
        "END_CONFIGURATION").scan()
    assert controller["one.twice"] == 10


def test_tasks_given_to_the_resource_stand_instead_of_the_programs_own():
    program = compile_program(text("TASK t(SINGLE := trigger); PROGRAM one WITH t : MAIN;"))
    controller = Controller(program, tasks=[Task("mine", 20 * MS, programs=("one",))]).scan(4)
    assert controller["one.n"] == 2


def test_a_program_declared_retain_is_retained_as_a_whole():
    retained = compile_program(text("PROGRAM RETAIN one : MAIN; PROGRAM NON_RETAIN two : MAIN;")) \
        .layout.retained
    assert {r.name.split(".")[0] for r in retained} == {"one"}
    assert ("one.a", "INT") in [(r.name, r.type) for r in retained]
