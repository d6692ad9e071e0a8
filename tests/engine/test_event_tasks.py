"""Tasks that an event releases (SINGLE; IEC 61131-3, 2.7.2 and table 50)."""

from itertools import pairwise

import pytest
from controller import MS, Controller

from plcemu.base.errors import PlcemuError
from plcemu.engine.resource import Resource
from plcemu.lang.compile import compile_program
from plcemu.runtime.plc import Plc

TEXT = """
PROGRAM COUNT VAR n : INT; END_VAR n := n + 1; END_PROGRAM
PROGRAM SET VAR_EXTERNAL trigger : BOOL; END_VAR VAR_INPUT go : BOOL; END_VAR
trigger := go; END_PROGRAM
CONFIGURATION C VAR_GLOBAL trigger : BOOL; END_VAR RESOURCE R ON CPU
{}
END_RESOURCE END_CONFIGURATION
"""
EVENT = "TASK t(SINGLE := trigger, PRIORITY := 5); PROGRAM p WITH t : COUNT;\n"


def runs(tasks, line, trigger="trigger"):
    controller = Controller(TEXT.format(tasks))
    counts = [0]
    for level in line:
        controller.diagram({trigger: level}, [])
        counts.append(controller["p.n"])
    return "".join("-" if b > a else "_" for a, b in pairwise(counts))


def test_a_rising_edge_runs_the_task_once():
    assert runs(EVENT, "__---__-_--_") == "__-____-_-__"


def test_a_trigger_that_is_true_at_first_is_an_edge():
    assert runs(EVENT, "---_-") == "-___-"


def test_an_address_can_be_the_trigger():
    assert runs(EVENT.replace("trigger", "%IX0.3"), "_--_-", "%IX0.3") == "_-__-"


def test_with_an_interval_the_task_is_periodic_while_the_trigger_is_false():
    tasks = EVENT.replace("PRIORITY", "INTERVAL := T#20ms, PRIORITY")
    assert runs(tasks, "_____-----____") == "-_-_--____-_-_"


@pytest.mark.parametrize(("priority", "expected"), [(1, "_-__"), (9, "__-_")])
def test_an_edge_that_a_task_makes_is_seen_in_order_of_priority(priority, expected):
    tasks = EVENT + f"TASK u(INTERVAL := T#10ms, PRIORITY := {priority}); PROGRAM s WITH u : SET;"
    assert runs(tasks, "_---", "s.go") == expected


def test_an_event_is_looked_for_at_every_release_of_the_resources_cycle():
    resource = Resource(compile_program(TEXT.format(EVENT)), 25 * MS)
    assert [resource.first_release_ns(t * MS) // MS for t in (0, 1, 25, 26)] == [0, 25, 25, 50]


def test_the_tasks_of_a_resource_are_named_once():
    tasks = EVENT.replace("PRIORITY", "INTERVAL := T#20ms, PRIORITY")
    resource = Resource(compile_program(TEXT.format(tasks)), 10 * MS)
    assert [t.name for t in resource.tasks] == ["t"]


def test_a_resource_that_waits_for_an_event_is_quiet_until_it_comes():
    controller = Controller(TEXT.format(EVENT)).scan(2)
    assert controller.resource.is_quiet()
    controller["trigger"] = True
    assert not controller.resource.is_quiet()
    controller.scan(2)
    assert controller.resource.is_quiet()


def test_skipping_idle_releases_loses_no_event():
    plc = Plc(compile_program(TEXT.format(EVENT)), record=True)
    plc.run_for("10s")
    for _ in range(3):
        plc["trigger"] = True
        plc.run_for("1s")
        plc["trigger"] = False
        plc.run_for("1s")
    assert plc["p.n"] == 3


def test_an_edge_that_a_less_urgent_task_makes_is_not_skipped():
    tasks = EVENT + "TASK u(INTERVAL := T#1s, PRIORITY := 9); PROGRAM s WITH u : SET;"
    plc = Plc(compile_program(TEXT.format(tasks)))
    plc["s.go"] = True
    plc.run_for("5s")
    assert plc["p.n"] == 1


def test_a_snapshot_holds_what_the_trigger_was():
    plc = Plc(compile_program(TEXT.format(EVENT)))
    plc["trigger"] = True
    plc.scan(2)
    image = plc.snapshot()
    twin = plc.fork()
    twin.scan(3)
    plc.restore(image)
    plc.scan(3)
    assert (plc["p.n"], twin["p.n"]) == (1, 1)


def test_a_cold_start_takes_a_true_trigger_for_an_edge_again():
    plc = Plc(compile_program(TEXT.format(EVENT.replace("trigger", "%IX0.0"))))
    plc["%IX0.0"] = True
    plc.scan(2)
    plc.restart(cold=True)
    plc["%IX0.0"] = True
    plc.scan(2)
    assert plc["p.n"] == 1


def test_a_fault_in_a_task_with_an_event_names_it():
    text = TEXT.format(EVENT).replace("n := n + 1;", "n := 1 / n;")
    controller = Controller(text)
    controller["trigger"] = True
    controller.scan()
    assert "task t" in str(controller.resource.fault)


def test_a_task_with_an_event_needs_a_cycle_to_look_for_it():
    tasks = EVENT.replace("PRIORITY", "INTERVAL := T#20ms, PRIORITY")
    with pytest.raises(PlcemuError, match="interval must be positive"):
        Resource(compile_program(TEXT.format(tasks)), 0)
