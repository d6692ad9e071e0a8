"""Sweeps on a real Dask cluster on the loopback network."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from processes import Command, Python
from systems import ROOT

from plcemu.runtime.config import ConfigText
from plcemu.runtime.sweep import Design, make_plan
from plcemu.runtime.workers import run_here

pytestmark = pytest.mark.acceptance

CONVEYOR = ROOT / "il_programs/conveyor"
SCRIPT = ROOT / "tests/support/sweep_on_cluster.py"
RUNS = 200


def start_worker(address: str, folder: Path) -> Python:
    return Python("-m", "distributed.cli.dask_worker", address, "--nworkers", "1", "--nthreads",
                  "1", "--no-nanny", "--no-dashboard", "--local-directory", folder)


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, list[Python]]]:
    """A scheduler's address and its two workers, of which a test may kill one."""
    with ExitStack() as stack:
        scheduler = stack.enter_context(Python(
            "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0",
            "--no-dashboard"))
        address = scheduler.wait_for(r"Scheduler at:\s*(tcp://\S+)")[1]
        workers = [stack.enter_context(start_worker(address, tmp_path_factory.mktemp("worker")))
                   for _ in range(2)]
        for worker in workers:
            worker.wait_for("Registered to:")
        yield address, workers


def test_a_worker_killed_in_the_middle_changes_no_result(
        cluster: tuple[str, list[Python]]) -> None:
    address, workers = cluster
    with Python(SCRIPT, CONVEYOR, address, RUNS) as sweep:
        sweep.wait_for(r"finished \d+")
        workers[0].kill()
        code, results = sweep.result()
    design = Design((), RUNS, seed=5)
    plan = make_plan(ConfigText.read(CONVEYOR), (), 600_000_000, design, ["plant.stop_mm"])
    expected = [each.as_json() for chunk in run_here(plan, design) for each in chunk]
    assert (code, results) == (0, expected)
    assert not workers[0].is_running


def test_the_command_gives_the_same_document_on_a_cluster_as_here(
        cluster: tuple[str, list[Python]]) -> None:
    sweep = ("sweep", CONVEYOR, "--runs", "40", "--seed", "3", "--json")
    with Command(*sweep, "--scheduler", cluster[0]) as there, \
            Command(*sweep, "--workers", "1") as here, \
            Command(*sweep, "--workers", "2") as on_cores:
        assert there.result() == here.result() == on_cores.result()


def test_where_no_scheduler_answers_the_command_says_so() -> None:
    with Command("sweep", CONVEYOR, "--runs", "2", "--scheduler", "tcp://127.0.0.1:1") as sweep:
        assert sweep.code() == 2
        assert "--scheduler tcp://127.0.0.1:1: no Dask scheduler answers there" in sweep.text
