"""The paper's controller with fixed durations, against the paper's own figures."""

from __future__ import annotations

import pytest
from paper_oracle import simulate

from plant_sim.batch_plant.loads import tanks_of_load

PERIODS_S = [
    (1.0, "solution", 3800),
    (1.5, "solution", 3180),
    (1.5, "water", 3800),
    *((load, "solution", 2060) for load in (2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0, 5.5, 6.0, 6.5)),
    *((load, "water", 2060) for load in (2.5, 3.5, 4.5, 5.5)),
    (6.5, "water", 3460),
    (7.0, "solution", 3460),
]
BARREN = [(0.0, "solution"), (8.0, "solution")]
BARREN += [(load, half) for load in (0.5, 7.5) for half in ("solution", "water")]


@pytest.mark.parametrize(("load", "half", "period_s"), PERIODS_S)
def test_the_long_run_period_of_a_load(load: float, half: str, period_s: int) -> None:
    assert simulate(tanks_of_load(load, half)).period_s == period_s


@pytest.mark.parametrize(("load", "half"), BARREN)
def test_too_little_or_too_much_produces_nothing(load: float, half: str) -> None:
    assert simulate(tanks_of_load(load, half)).batches_s == []


def test_load_1_starts_its_tenth_batch_when_table_2_says() -> None:
    assert simulate(tanks_of_load(1.0, "solution")).batches_s[9] == 34760
