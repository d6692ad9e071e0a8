"""What a batch plant can start with: contents of single tanks, and loads filled in from the top."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import NamedTuple

from plant_sim.batch_plant.layout import (
    BOILING_DEGC,
    COLD_DEGC,
    CONCENTRATION_G_L,
    MIXED_L,
    SOLUTION_L,
    WATER_L,
    Liquid,
)

_SOLUTION_COLD = ("empty", "sol42C", "sol84C")
_WATER_COLD = ("empty", "water28C", "water56C")

CONTENTS: dict[str, tuple[str, ...]] = {
    "B1": _SOLUTION_COLD,
    "B2": _WATER_COLD,
    "B3": ("empty", "sol42C", "water28C", "sol70C"),
    "B4": ("empty", "sol70C", "sol140C"),
    "B5": ("empty", "sol70C", "sol42H"),
    "B6": (*_WATER_COLD, "water28H", "water56H"),
    "B7": (*_SOLUTION_COLD, "sol42H", "sol84H"),
}
"""Tank -> what it may hold at first: the 8100 configurations that the paper counts."""

_ALIASES = {"sol82C": "sol84C", "sol82H": "sol84H"}


class Content(NamedTuple):
    """A volume in l at a concentration in g/l and a temperature in degC."""

    volume_l: Fraction
    concentration_g_l: Fraction
    temperature_degC: int


_MEASURES: dict[str, tuple[Liquid, Fraction]] = {
    "sol42": ("solution", SOLUTION_L),
    "sol84": ("solution", 2 * SOLUTION_L),
    "water28": ("water", WATER_L),
    "water56": ("water", 2 * WATER_L),
    "sol70": ("mixed", MIXED_L),
    "sol140": ("mixed", 2 * MIXED_L),
}


def content_of(word: str) -> Content:
    """What a content word stands for: liquid, tenths of litres, C for cold or H for hot."""
    if word == "empty":
        return Content(Fraction(0), Fraction(0), COLD_DEGC)
    liquid, volume_l = _MEASURES[word[:-1]]
    temperature = BOILING_DEGC if word.endswith("H") else COLD_DEGC
    return Content(volume_l, CONCENTRATION_G_L[liquid], temperature)


def read_tanks(found: object) -> Mapping[str, str]:
    """Contents by tank, from a mapping or from text `B1=sol84C,B3=water28C`.

    Raises ValueError that says what was expected.
    """
    if isinstance(found, str):
        pairs = [item.partition("=")[::2] for item in found.split(",") if item.strip()]
    elif isinstance(found, Mapping):
        pairs = [(str(tank), str(word)) for tank, word in found.items()]
    else:
        raise ValueError("TANK=CONTENT,... or a mapping of tanks to contents")
    return dict(_checked(tank.strip(), word.strip()) for tank, word in pairs)


def _checked(tank: str, word: str) -> tuple[str, str]:
    if tank not in CONTENTS:
        raise ValueError(f"a tank B1 to B7 where {tank!r} stands")
    word = _ALIASES.get(word, word)
    if word not in CONTENTS[tank]:
        raise ValueError(f"{tank} to be one of {', '.join(CONTENTS[tank])}")
    return tank, word


def tanks_of_load(load: float, half: str) -> dict[str, str]:
    """The contents by tank for `load` batches (0 to 8 in halves); `half` is what n.5 adds.

    Whole batches go in as solution to B1 and water to B2 (two), as mixed batches to B3 (one), B4
    (two) and B5 (one), then as cold water to B6 and cold solution to B7 (two). The half goes to
    the first tank from the top that can hold it.
    """
    whole = int(load)
    separate = min(whole, 2) + max(whole - 6, 0)
    mixed = max(min(whole - 2, 4), 0)
    units = {"solution": separate, "water": separate}
    if load != whole:
        units[half] += 1
    in_b3 = "empty"
    if load == 2.5:
        in_b3 = "sol42C" if half == "solution" else "water28C"
        units[half] -= 1
    words = {
        "B1": _SOLUTION_COLD[min(units["solution"], 2)],
        "B2": _WATER_COLD[min(units["water"], 2)],
        "B3": "sol70C" if mixed >= 1 else in_b3,
        "B4": CONTENTS["B4"][max(min(mixed - 1, 2), 0)],
        "B5": "sol70C" if mixed >= 4 else "empty",
        "B6": _WATER_COLD[max(units["water"] - 2, 0)],
        "B7": _SOLUTION_COLD[max(units["solution"] - 2, 0)],
    }
    return {tank: word for tank, word in words.items() if word != "empty"}
