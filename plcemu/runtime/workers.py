"""Where the runs of a sweep are executed: here, on all cores, or on a Dask cluster."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from importlib import import_module
from typing import Any

from plcemu.base.errors import PlcemuError
from plcemu.runtime.sweep import Design, Plan, Result, chunks, execute_chunk, packed

CHUNK = 25
"""Runs handed to a worker together, at most."""

_WAITING = 4
"""Chunks a worker that wait or run at a time, so that millions of runs need no memory at once."""

CONNECT_S = 10
"""How long a scheduler may take to answer."""


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else \
        os.cpu_count() or 1


def run_here(plan: Plan, design: Design) -> Iterator[list[Result]]:
    """Execute one run after the other in this process."""
    for run in design:
        yield [plan.execute(run)]


def run_on_cores(plan: Plan, design: Design, workers: int) -> Iterator[list[Result]]:
    """Execute the runs in processes; results come as they are ready.

    Raises:
        PlcemuError: a process died.
    """
    data = packed(plan)
    size = max(1, min(CHUNK, design.total // (workers * 4)))
    # Processes are not forked from this one: the engine may have threads, which a fork breaks.
    method = "forkserver" if sys.platform == "linux" else "spawn"
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context(method), _begin_worker)
    waiting: set[Future[list[Result]]] = set()
    try:
        for chunk in chunks(design, size):
            waiting.add(pool.submit(execute_chunk, chunk, data))
            if len(waiting) >= workers * _WAITING:
                done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                yield from (each.result() for each in done)
        while waiting:
            done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
            yield from (each.result() for each in done)
        pool.shutdown()
    except BrokenProcessPool:
        raise PlcemuError("a process of the sweep died, perhaps for want of memory; try fewer "
                          "with --workers") from None
    finally:
        if waiting:
            own = list((pool._processes or {}).values())
            pool.shutdown(wait=False, cancel_futures=True)
            for process in own:
                process.terminate()


def _begin_worker() -> None:
    """Leave Ctrl-C to the process that waits for the results."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def run_on_cluster(plan: Plan, design: Design, address: str) -> Iterator[list[Result]]:
    """Execute the runs on the workers of a Dask scheduler, which may come and go meanwhile.

    Raises:
        PlcemuError: there is no scheduler, or its workers cannot execute the runs.
    """
    try:
        distributed: Any = import_module("distributed")
    except ImportError as problem:
        raise PlcemuError(f"--scheduler needs the extra 'cluster' ({problem}): "
                          "pip install 'plcemu[cluster]'") from None
    try:
        client = distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as problem:
        raise PlcemuError(f"--scheduler {address}: no Dask scheduler answers there: "
                          f"{problem}") from None
    with client:
        # A task of its own, so that the scheduler can make it again if its worker dies.
        data = client.submit(bytes, packed(plan))
        futures: list[Any] = client.map(execute_chunk, list(chunks(design, CHUNK)), plan=data,
                                        pure=False)
        try:
            for future in distributed.as_completed(futures, loop=client.loop):
                yield _result_of(future)
        finally:
            client.cancel([f for f in futures if not f.done()])


def _result_of(future: Any) -> list[Result]:
    try:
        results: list[Result] = future.result()
    except Exception as problem:  # whatever a worker of the cluster met
        raise PlcemuError(f"a worker of the cluster could not execute its runs: "
                          f"{type(problem).__name__}: {problem}") from problem
    return results
