"""What keeping retained variables costs: a commit in place beside a new file with rename, and the
part of it that the scan pays.

    python benchmarks/retain_cost.py [FOLDER]      # on the file system of the folder
"""

from __future__ import annotations

import os
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from plcemu.io.retain import Commit, RetainedImage, RetainFile, pack
from plcemu.ir.shape import Array, Scalar, Variable

ROUNDS = 40


def median_us(work: Callable[[], object]) -> float:
    """Return the median time of a piece of work, in µs."""
    times = []
    for _ in range(ROUNDS):
        begin = time.perf_counter_ns()
        work()
        times.append(time.perf_counter_ns() - begin)
    return statistics.median(times) / 1e3


def by_rename(folder: Path, raw: bytes) -> None:
    """Write a new file, sync it, put it in the old one's place, sync the folder."""
    temporary = folder / "renamed.new"
    with temporary.open("wb") as file:
        file.write(raw)
        file.flush()
        os.fsync(file.fileno())
    temporary.replace(folder / "renamed")
    fd = os.open(folder, os.O_RDONLY)
    os.fsync(fd)
    os.close(fd)


def measure(folder: Path, count: int) -> tuple[float, float, float]:
    """Return the median µs of gathering, of a commit in place and of one by rename."""
    shape = Array(Scalar("BYTE", 1), ((1, count),), 1)
    image = RetainedImage((Variable("MAIN.a", "ARRAY", shape, 0),))
    block = bytearray(os.urandom(count))
    file = RetainFile(folder / f"kept{count}")
    raw = pack(Commit(1, 1, image.schema, bytes(block)))
    file.commit(image.schema, bytes(block))
    results = (median_us(lambda: image.gather(block)),
               median_us(lambda: file.commit(image.schema, bytes(block))),
               median_us(lambda: by_rename(folder, raw)))
    file.close()
    return results


def main() -> None:
    """Print a table."""
    where = sys.argv[1] if len(sys.argv) > 1 else None
    print(f"{'bytes':>9} {'gather µs':>10} {'in place µs':>12} {'rename µs':>10} {'ratio':>6}")
    with tempfile.TemporaryDirectory(dir=where) as name:
        for count in (100, 10_000, 1_000_000):
            gather, place, rename = measure(Path(name), count)
            print(f"{count:>9} {gather:>10.1f} {place:>12.0f} {rename:>10.0f} "
                  f"{rename / place:>6.1f}")


if __name__ == "__main__":
    main()
