"""Time travel: rewind, replay, fork and diff say what a PLC that never travelled says."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from journeys import do, journeys, programs, stand
from systems import batch_system

import plcemu
from plcemu.base.tracefile import save
from plcemu.runtime.history import LAPS_A_KEYFRAME, History, HistoryError

MS, S = 1_000_000, 1_000_000_000

COUNTER = """PROGRAM MAIN
VAR start AT %IX0.0 : BOOL; lamp AT %QX0.0 : BOOL; n : INT; half : REAL; END_VAR
  n := n + 1;
  lamp := start;
END_PROGRAM
"""
IDLE = """PROGRAM MAIN
VAR start AT %IX0.0 : BOOL; lamp AT %QX0.0 : BOOL; delay : TON; END_VAR
  delay(IN := start, PT := T#1s);
  lamp := delay.Q;
END_PROGRAM
"""


def recorded(program=COUNTER, engine="interpreter", **options):
    return plcemu.Plc(program, engine=engine, record=True, **options)


def scan(plc):
    plc.scan()


def trace_bytes(plc, folder):
    save(plc.trace, folder / "trace.jsonl")
    return (folder / "trace.jsonl").read_bytes()


class Witness:
    """Notes in what state each lap of a PLC finds it."""

    def __init__(self, plc):
        self.cycle, self.found = plc._cycle, {}
        self.cycle.recorder = self

    def before_lap(self):
        self.found[self.cycle.scan_number] = self.state()

    def after_lap(self):
        pass

    def state(self):
        point = self.cycle.resource.checkpoint()
        return (self.cycle.t_ns, point._replace(fault=str(point.fault)),
                self.cycle.exchange.checkpoint())


# ---------------------------------------------------------------- random journeys


@given(programs, journeys, st.data())
@settings(max_examples=40, deadline=None)
def test_rewind_to_any_executed_scan_gives_the_state_that_the_scan_found(program, way, data):
    plc, twin = recorded(program), plcemu.Plc(program, engine="interpreter")
    witness = Witness(twin)
    do(plc, [scan, *way])
    do(twin, [scan, *way])
    target = data.draw(st.sampled_from(sorted(witness.found)))
    plc.rewind(target)
    assert Witness.state(Witness(plc)) == witness.found[target]


@given(programs, journeys, st.data())
@settings(max_examples=40, deadline=None)
def test_a_replay_after_a_rewind_gives_the_same_trace_and_state(program, way, data):
    plc = recorded(program)
    do(plc, [*way, scan])
    there, frames = stand(plc), list(plc.trace.frames)
    plc.rewind(data.draw(st.integers(0, plc.scan_number)))
    plc.replay()
    assert (stand(plc), plc.trace.frames) == (there, frames)


@given(programs, journeys, journeys, journeys)
@settings(max_examples=40, deadline=None)
def test_a_rewound_plc_is_driven_on_as_if_the_future_had_never_been(program, way, future, other):
    plc, twin = recorded(program), recorded(program)
    do(plc, [*way, scan])
    do(twin, [*way, scan])
    do(plc, [scan, *future])
    plc.rewind(twin.scan_number)
    do(plc, [scan, *other])
    do(twin, [scan, *other])
    assert (stand(plc), plc.trace.frames) == (stand(twin), twin.trace.frames)


@given(programs, journeys, journeys)
@settings(max_examples=40, deadline=None)
def test_after_another_way_the_new_way_is_what_is_replayed(program, way, other):
    plc = recorded(program)
    do(plc, [scan, *way])
    plc.rewind(0)
    do(plc, [*other, scan])
    there, frames = stand(plc), list(plc.trace.frames)
    plc.rewind(0)
    plc.replay()
    assert (stand(plc), plc.trace.frames) == (there, frames)


@given(programs, journeys, journeys, st.data())
@settings(max_examples=40, deadline=None)
def test_a_fork_of_a_past_scan_and_its_origin_do_not_touch_each_other(program, way, other, data):
    plc, rewound = recorded(program), recorded(program)
    do(plc, [*way, scan])
    do(rewound, [*way, scan])
    target = data.draw(st.integers(0, plc.scan_number))
    there = stand(plc)
    fork = plc.fork(scan=target)
    do(fork, other)
    assert stand(plc) == there
    rewound.rewind(target)
    do(rewound, other)
    assert stand(fork) == stand(rewound)


@given(programs, journeys, journeys)
@settings(max_examples=40, deadline=None)
def test_diff_is_what_reading_every_tag_of_both_states_finds(program, way, on):
    plc = recorded(program)
    do(plc, way)
    old, probe = plc.snapshot(), recorded(program)
    do(plc, [scan, *on])
    new = plc.snapshot()
    values = []
    for image in (old, new):
        probe.restore(image)
        values.append({slot.tag.name: probe[slot.tag.name]
                       for slot in probe._resource.program.layout.slots})
    expected = [(name, before, values[1][name]) for name, before in values[0].items()
                if repr(before) != repr(values[1][name])]
    assert [tuple(d) for d in plc.diff(old)] == expected


# ---------------------------------------------------------------- one by one


@pytest.mark.parametrize("engine", ["interpreter", "auto"])
def test_the_trace_after_rewind_and_replay_is_the_same_in_bytes(tmp_path, engine):
    plc = recorded(engine=engine)
    for level in (True, False, True):
        plc["start"] = level
        plc.scan(300)
    before = trace_bytes(plc, tmp_path)
    plc.rewind(401)
    assert plc.trace.frames[-1].scan == 400
    plc.replay()
    assert trace_bytes(plc, tmp_path) == before


def test_rewind_by_time_stands_before_the_first_scan_from_that_instant_on():
    plc = recorded()
    plc.scan(50)
    plc.rewind(t_ns=201 * MS)
    assert (plc.t_ns, plc.scan_number, plc["n"]) == (210 * MS, 21, 21)


def test_rewind_into_a_stretch_of_scans_that_were_passed_over():
    plc, dense = recorded(IDLE), recorded(IDLE)
    plc.run_for("5s")
    plc["start"] = True
    plc.run_for("5s")
    plc.rewind(123)
    dense.scan(123)
    assert stand(plc) == stand(dense)
    plc.rewind(t_ns=3 * S)
    assert (plc.t_ns, plc.scan_number) == (3 * S, 300)
    plc.replay()
    assert (plc.t_ns, plc["lamp"]) == (10 * S, True)


def test_replay_may_stop_on_the_way_and_go_on():
    plc = recorded()
    plc.scan(1000)
    plc.rewind(10)
    plc.replay(until_scan=600)
    assert (plc["n"], plc.scan_number) == (600, 600)
    plc.replay()
    assert (plc["n"], plc.scan_number) == (1000, 1000)


def test_a_fault_is_travelled_back_from_and_met_again():
    plc = recorded("PROGRAM MAIN VAR n : INT := 5; m : INT; END_VAR n := n - 1; m := 10 / n; "
                   "END_PROGRAM")
    plc.scan(8)
    assert plc.state == "FAULT"
    plc.rewind(2)
    assert (plc.state, plc.fault, plc["n"]) == ("RUN", "", 3)
    plc.replay()
    assert plc.state == "FAULT"


def test_writes_that_wait_are_forgotten_by_a_rewind():
    plc = recorded()
    plc.scan(3)
    plc["start"] = True
    plc.rewind(2)
    assert plc["start"] is False
    plc.scan()
    assert plc["lamp"] is False


def test_a_change_after_a_rewind_is_no_replay():
    plc = recorded()
    plc.scan(5)
    plc.rewind(2)
    plc.force("start", True)
    with pytest.raises(HistoryError, match="changed since the rewind"):
        plc.replay()


def test_the_history_stays_within_its_bound_and_tells_how_far_back_it_reaches():
    plc = recorded(history=60_000)
    plc.scan(40 * LAPS_A_KEYFRAME)
    history = plc.history
    assert 30_000 < history.size <= 60_000 + 16 * LAPS_A_KEYFRAME
    assert history.first_scan > LAPS_A_KEYFRAME
    plc.rewind(history.first_scan)
    assert plc["n"] == (plc.scan_number + 2**15) % 2**16 - 2**15
    with pytest.raises(HistoryError, match=rf"from scan {history.first_scan} .*60000 bytes"):
        plc.rewind(history.first_scan - 1)
    with pytest.raises(HistoryError, match="is not recorded"):
        plc.rewind(t_ns=0)


@pytest.mark.parametrize("target", [-1, 6])
def test_a_scan_that_was_never_executed_is_refused(target):
    plc = recorded()
    plc.scan(5)
    with pytest.raises(HistoryError, match=f"scan {target} is not recorded"):
        plc.rewind(target)


def test_without_recording_there_is_no_way_back():
    plc = plcemu.Plc(COUNTER)
    plc.scan()
    with pytest.raises(HistoryError, match="record=True"):
        plc.rewind(0)
    with pytest.raises(TypeError, match="one of the two"):
        recorded().rewind()


def test_diff_takes_scans_snapshots_and_other_plcs():
    plc = recorded()
    plc.scan(3)
    twin = plc.fork()
    twin["start"] = True
    twin.scan()
    assert [tuple(d) for d in plc.diff(1)] == [("MAIN.n", 1, 3)]
    assert [tuple(d) for d in plc.diff(0, 2)] == [("MAIN.n", 0, 2)]
    assert {d.name for d in plc.diff(plc.snapshot(), twin)} == {"MAIN.start", "MAIN.lamp", "MAIN.n"}
    with pytest.raises(ValueError, match="another program"):
        plc.diff(b"short")


# ---------------------------------------------------------------- with a plant and monitors


def test_a_plant_and_its_monitors_travel_too():
    system = batch_system("load=3")
    history = History(system.cycle)
    system.cycle.run_virtual(900 * S)
    middle = system.cycle.scan_number
    system.cycle.run_virtual(1800 * S)
    there, end = system.report(), system.cycle.scan_number
    history.rewind(middle)
    assert system.cycle.t_ns == 900 * S
    history.replay()
    again = system.report()
    assert system.cycle.scan_number == end
    assert {k: again[k] for k in ("properties", "tags", "scans")} == \
        {k: there[k] for k in ("properties", "tags", "scans")}
    assert again["plant"] == there["plant"]


def test_a_past_of_a_plant_is_taken_up_by_an_equal_system():
    origin, twin = batch_system("load=3"), batch_system("load=3")
    history = History(origin.cycle)
    origin.cycle.run_virtual(1500 * S)
    history.place(twin.cycle, history.scan_at(700 * S))
    twin.cycle.run_virtual(1500 * S)
    assert twin.report()["tags"] == origin.report()["tags"]
