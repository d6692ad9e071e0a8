"""Chance that does not depend on who asks how often: numbers drawn by name.

A draw is a pure function of a seed and a key, such as ("B1.level", 17) for the noise of a sensor's
17th sample. So noise is the same however often a sensor is read, and needs no state in snapshots.
"""

from __future__ import annotations

from hashlib import blake2b
from statistics import NormalDist

_BITS = 52
_NORMAL = NormalDist()

Key = str | int


def uniform(seed: int, *key: Key) -> float:
    """A number in (0, 1), evenly distributed over all keys."""
    text = "/".join([str(seed), *map(str, key)]).encode()
    drawn = int.from_bytes(blake2b(text, digest_size=8).digest(), "big") >> (64 - _BITS)
    return (drawn + 0.5) / (1 << _BITS)


def normal(seed: int, *key: Key) -> float:
    """A number from the normal distribution with mean 0 and standard deviation 1."""
    return _NORMAL.inv_cdf(uniform(seed, *key))
