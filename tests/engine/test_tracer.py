"""The trace of a run tells what the run did: same memory, same faults, every store in order."""

from hypothesis import given, settings
from hypothesis import strategies as st
from journeys import programs

from plcemu.base.errors import ProgramFault
from plcemu.engine.interpreter import Interpreter
from plcemu.engine.memory import Memory
from plcemu.engine.tracer import Tracer
from plcemu.lang.compile import compile_program

BLOCKS = """FUNCTION_BLOCK FB
VAR_INPUT a : INT; END_VAR VAR t : TON; END_VAR VAR_OUTPUT q : INT; END_VAR
  q := a + 1;
  t(IN := q > 3, PT := T#1s);
END_FUNCTION_BLOCK
FUNCTION square : INT VAR_INPUT x : INT; END_VAR square := x * x; END_FUNCTION
PROGRAM MAIN
VAR n : INT := 6; f : FB; s : STRING[5]; arr, other : ARRAY[1..3] OF INT; END_VAR
  f(a := n);
  arr[2] := square(n);
  s := 'ab';
  other := arr;
END_PROGRAM"""


class Run:
    """A program's only instance on a memory of its own, with the values given."""

    def __init__(self, text, **values):
        self.program = compile_program(text)
        self.memory = Memory(self.program.layout, bytearray(self.program.layout.initial))
        for name, value in values.items():
            offset, row = self.memory.place(self.memory.tags.find(name))
            self.memory.block[offset:offset + row.size] = row.pack(value)
        (instance,) = self.program.instances
        self.place = (instance.function, instance.base)
        self.events, self.fault = [], ""

    def traced(self):
        try:
            for event in Tracer(self.program, self.memory).events([self.place], "main"):
                self.events.append(event)
        except ProgramFault as fault:
            self.fault = str(fault)
        return self

    def plain(self):
        try:
            Interpreter(self.program, self.memory.block).run(*self.place)
        except ProgramFault as fault:
            self.fault = str(fault)
        return self


@given(programs, st.sampled_from([-7, 0, 5]), st.booleans())
@settings(max_examples=80, deadline=None)
def test_a_traced_run_ends_as_an_untraced_one_and_its_writes_rebuild_the_memory(
        text, level, start):
    rebuilt = bytearray(Run(text, level=level, start=start).memory.block)
    traced = Run(text, level=level, start=start).traced()
    plain = Run(text, level=level, start=start).plain()
    assert (traced.memory.block, traced.fault) == (plain.memory.block, plain.fault)
    for event in traced.events:
        for access in event.writes:
            rebuilt[access.address:access.address + len(access.data)] = access.data
    assert rebuilt == plain.memory.block


def test_every_store_is_told_with_its_tag_in_order():
    events = Run(BLOCKS).traced().events
    told = [(a.name, a.value) for e in events for a in e.writes if a.name]
    assert told[:3] == [("MAIN.f.a", 6), ("MAIN.f.q", 7), ("MAIN.f.t.IN", True)]
    assert told[-5:] == [("MAIN.arr[2]", 36), ("MAIN.s", "ab"), ("MAIN.other[1]", 0),
                         ("MAIN.other[2]", 36), ("MAIN.other[3]", 0)]


def test_reads_tell_what_was_there():
    events = Run(BLOCKS, n=41).traced().events
    first = next(e for e in events if e.reads)
    assert (first.reads[0].name, first.reads[0].value, first.result) == ("MAIN.n", 41, 41)
    assert str(first) == "MAIN:0 load i16 this 0  ; reads MAIN.n = 41"


def test_instances_depths_and_lines_are_told():
    events = Run(BLOCKS).traced().events
    seen = list(dict.fromkeys((e.instance, e.pou, e.depth) for e in events))
    assert seen == [("MAIN", "MAIN", 0), ("MAIN.f", "FB", 1), ("MAIN.f.t", "TON", 2),
                    ("", "square", 1)]
    store = next(e for e in events if any(a.name == "MAIN.f.q" for a in e.writes))
    assert (store.line, store.task) == (("<text>", 3), "main")


def test_a_fault_is_the_last_event():
    run = Run("PROGRAM MAIN VAR n, m : INT; END_VAR m := 7; m := m / n; END_PROGRAM").traced()
    assert run.events[-1].fault == "division by zero"
    assert run.events[-1].instr.op == "div.i16"
    assert "division by zero" in run.fault


def test_a_run_that_does_not_end_uses_up_its_budget():
    run = Run("PROGRAM MAIN VAR n : INT; END_VAR WHILE TRUE DO n := n + 1; END_WHILE; END_PROGRAM")
    events = Tracer(run.program, run.memory).events([run.place], budget=100)
    last = None
    try:
        for event in events:
            last = event
    except ProgramFault as fault:
        run.fault = fault.reason
    assert last is not None
    assert last.fault == run.fault != ""
