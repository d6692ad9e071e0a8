"""The conveyor's scan cycle with jitter stops within exact intervals, and reaches their ends."""

from fractions import Fraction

import pytest
from systems import ROOT

from plcemu.runtime.config import ConfigText
from plcemu.runtime.system import System

TEXT = ConfigText.read(ROOT / "il_programs/conveyor")
MS = 1_000_000
ROUNDING_MM = 1e-6
"""Ten ns at 200 mm/s would be 2e-6 mm: durations are whole ns."""


def stop_mm(*overrides, until_ns=1000 * MS):
    """Run the real scan cycle until the conveyor has stopped; return where."""
    system = System(TEXT.config(overrides))
    system.cycle.run_virtual(until_ns)
    facts = system.plant.coupling.plant.observe()
    assert facts["stops"] == 1
    return facts["stop_mm"]


def interval_mm(cycle_ms, deviation, low_speed, high_speed):
    """All stops that cycles within the jitter and a constant speed can give, by brute force.

    The motor starts at a boundary with X = 0. The switch at 80 mm is seen at the boundary number n
    if boundary n - 1 comes before the arrival; the motor stops one cycle later. For each n the
    earliest and latest boundaries follow, and the stop is linear in speed and time between them.
    """
    shortest, longest = (cycle_ms * (1 + sign * deviation) for sign in (-1, 1))
    stops = []
    for speed in (low_speed, high_speed):
        arrival = 80 / speed
        for n in range(1, int(arrival / shortest) + 3):
            if (n - 1) * shortest < arrival <= n * longest:
                stops.append(speed * (max(arrival, n * shortest) + shortest))
                stops.append(speed * (min(n * longest, arrival + longest) + longest))
    return min(stops), max(stops)


PER_MS = Fraction(1, 1000)


def test_the_interval_of_the_paper_s_check_value():
    low, high = interval_mm(Fraction(11), Fraction(5, 1000), 200 * PER_MS, 200 * PER_MS)
    assert (round(float(low), 3), round(float(high), 3)) == (83.182, 84.018)


CYCLES = ["5.1", "7.4", "9.0", "11", "13.1", "14"]


@pytest.mark.parametrize("cycle", CYCLES)
@pytest.mark.parametrize("per", ["cycle", "run"])
def test_every_run_stops_inside_the_exact_interval(cycle, per):
    low, high = interval_mm(Fraction(cycle), Fraction(5, 1000), 200 * PER_MS, 200 * PER_MS)
    stops = [stop_mm(f"cycle={cycle}ms", f"jitter.per={per}", f"seed={seed}")
             for seed in range(5)]
    assert low - ROUNDING_MM <= min(stops)
    assert max(stops) <= high + ROUNDING_MM


def test_runs_at_the_corners_of_the_jitter_reach_the_ends_of_the_interval_at_11_ms():
    low, high = interval_mm(Fraction(11), Fraction(5, 1000), 200 * PER_MS, 200 * PER_MS)
    assert stop_mm("cycle=10945us", "jitter=0 %") == pytest.approx(low, abs=ROUNDING_MM)
    assert stop_mm("cycle=11055us", "jitter=0 %") == pytest.approx(high, abs=ROUNDING_MM)


def test_where_the_number_of_cycles_is_open_steady_deviations_come_close_to_both_ends():
    """At 14 ms the switch is seen at boundary 29, or at 28 if all cycles are long enough.

    A steady deviation cannot make the last cycles long and the others short; what it misses is at
    most two cycles' whole jitter.
    """
    low, high = interval_mm(Fraction(14), Fraction(2, 100), 200 * PER_MS, 200 * PER_MS)
    cycles_us = range(13720, 14281, 40)
    stops = [stop_mm(f"cycle={us}us", "jitter=0 %") for us in cycles_us]
    missed = 2 * 2 * 0.28 * 0.2
    assert low - ROUNDING_MM <= min(stops) <= low + missed
    assert high - missed <= max(stops) <= high + ROUNDING_MM


def test_an_unknown_constant_speed_widens_the_interval():
    low, high = interval_mm(Fraction("13.1"), Fraction(5, 1000), Fraction("199.2") * PER_MS,
                            Fraction("200.8") * PER_MS)
    stops = [stop_mm("cycle=13.1ms", "perturbation_pct=0.4", f"seed={seed}")
             for seed in range(10)]
    assert low - ROUNDING_MM <= min(stops)
    assert max(stops) <= high + ROUNDING_MM


def test_the_way_back_takes_between_3000_and_3500_ms():
    system = System(TEXT.config(["jitter=0 %", "cycle=1ms"]))
    system.cycle.observers.append(seen := Times("CONVEYOR.BACK.X", system.cycle.tags))
    system.cycle.run_virtual(20_000 * MS)
    begins, ends = seen.times[1::2], seen.times[2::2]
    durations = [end - begin for begin, end in zip(begins, ends, strict=False)]
    assert len(durations) >= 4
    assert all(3000 * MS < each <= 3503 * MS for each in durations)


class Times:
    """Notes when a tag changes."""

    def __init__(self, name, tags):
        self.index, self.times = tags.find(name), []

    def observe(self, frame):
        self.times += [frame.t_ns for index, _ in frame.changes if index == self.index]


def test_properties_hold_in_a_run_of_several_gears():
    system = System(TEXT.config())
    system.cycle.run_virtual(30_000 * MS)
    assert {r["verdict"] for r in system.report()["properties"]} <= {
        "presumably satisfied", "presumably violated"}
    assert system.report()["tags"]["CONVEYOR.cycles"] >= 6
