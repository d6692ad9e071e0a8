"""Closed loops with forces, clients, faults and travels: skipped and dense runs tell the same."""

from collections.abc import Sequence
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st
from lockstep import traced
from systems import MS, ROOT

from plcemu.base.trace import Frame
from plcemu.runtime.config import load_config
from plcemu.runtime.scenario import Scenario, parse_fault
from plcemu.runtime.system import System

LEVEL = "B1_level"


class Loop:
    """The batch plant, quick beside its PLC, with interventions."""

    def __init__(self, faults: Sequence[str], dense: bool) -> None:
        config = load_config(ROOT / "il_programs" / "batch_plant", ("plant.time_scale=50",))
        self.system = System(config, scenario=sum(map(parse_fault, faults), Scenario()))
        self.cycle, self.dense = self.system.cycle, dense
        self.trace = traced(self.system)
        memory = self.system.resource.memory
        self.level, self.row = memory.place(memory.tags.find(LEVEL))

    def wait(self, cycles: int) -> None:
        self.cycle.run_virtual(self.cycle.t_ns + cycles * 20 * MS, dense=self.dense)

    def force(self, value: int) -> None:
        self.system.exchange.force(self.level, self.row.pack(value))
        self.system.resource.inputs_changed()

    def unforce(self, _: int) -> None:
        self.system.exchange.unforce(self.level)
        self.system.resource.inputs_changed()

    def write_output(self, value: int) -> None:
        self.system.exchange.port("client").write("QX", value % 4, bytes([255]), bytes([value]))

    def write_input(self, value: int) -> None:
        self.system.exchange.port("client").write("IW", 8, value.to_bytes(2, "big"))

    def stop(self, _: int) -> None:
        self.cycle.stop()

    def resume(self, _: int) -> None:
        self.cycle.resume()

    def travel(self, _: int) -> None:
        self.cycle.return_to(self.cycle.checkpoint())

    def play(self, script: Sequence[tuple[int, str, int]]) -> "Loop":
        for cycles, deed, value in script:
            self.wait(cycles)
            getattr(self, deed)(value)
        self.wait(500)
        return self

    def told(self) -> tuple[list[Frame], dict[str, Any], bytes]:
        """Return the trace, the report but for the number of executed laps, and all memory."""
        report = self.system.report()
        del report["executed"]
        return ([f for f in self.trace.frames if f.changes], report,
                self.system.resource.snapshot())


deeds = st.sampled_from(["force", "unforce", "write_output", "stop", "resume", "travel",
                         "write_input"])
scripts = st.lists(st.tuples(st.integers(0, 400), deeds, st.integers(1, 200)), max_size=6)
faults = st.lists(st.sampled_from(["V8 stuck at 2s", "B3 leak 0.02 at 3s until 6s",
                                   "B5.temperature drift 0.1 at 1s", "Pump1 worn 0.5 at 4s"]),
                  max_size=2, unique=True)


@given(scripts, faults)
@settings(max_examples=12, deadline=None)
def test_a_loop_that_skips_tells_what_the_dense_one_tells(script, chosen):
    assert Loop(chosen, dense=False).play(script).told() == \
        Loop(chosen, dense=True).play(script).told()
