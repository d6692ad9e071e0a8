"""The plant that docs/plants.md shows, run as a user would."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from plant_sim import PlantLoadError, load

DOCS = Path(__file__).parents[2] / "docs" / "plants.md"
S = 1_000_000_000


def kettle_text() -> str:
    found = re.search(r"<!-- file: kettle.py -->\n```python\n(.*?)```", DOCS.read_text("utf-8"),
                      re.DOTALL)
    assert found is not None
    return found[1]


@pytest.fixture
def kettle_file(tmp_path: Path) -> Path:
    path = tmp_path / "kettle.py"
    path.write_text(kettle_text(), encoding="utf-8")
    return path


def test_a_plant_of_ones_own_has_fewer_than_60_lines() -> None:
    assert len(kettle_text().splitlines()) < 60


@pytest.mark.parametrize("ending", ["", ":Kettle"])
def test_it_is_loaded_from_its_file(kettle_file: Path, ending: str) -> None:
    kettle = load(f"{kettle_file}{ending}", {"inflow_l_s": 0.5})
    kettle.actuate({"inlet": True})
    kettle.watch(["full", "empty"])
    assert kettle.next_event_ns() == 1
    kettle.advance(1)
    assert kettle.next_event_ns() == 4 * S
    kettle.advance(5 * S)
    assert kettle.observe() == {"overflow": True}
    assert kettle.sense() == {"full": True, "empty": False}


@pytest.mark.parametrize(("text", "said"), [
    ("x = (", "line 1: '\\(' was never closed"),
    ("a = 1\nraise RuntimeError('no')", "line 2: RuntimeError: no"),
    ("import nowhere_at_all", "line 1: ModuleNotFoundError"),
    ("a = 1", "expected one plant class, found none"),
])
def test_a_file_that_is_no_plant_is_refused_with_its_line(tmp_path: Path, text: str,
                                                          said: str) -> None:
    path = tmp_path / "wrong.py"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(PlantLoadError, match=said):
        load(str(path))


def test_a_file_that_is_not_there_is_told() -> None:
    with pytest.raises(PlantLoadError, match="cannot be read: No such file"):
        load("nowhere.py:Kettle")


def test_a_class_that_is_not_there_is_told(kettle_file: Path) -> None:
    with pytest.raises(PlantLoadError, match="has no class Teapot"):
        load(f"{kettle_file}:Teapot")
