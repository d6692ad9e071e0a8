"""The tag table: names, endings of names and addresses."""

import pytest

from plcemu.base.errors import UnknownNameError
from plcemu.base.tags import Tag, TagTable

TABLE = TagTable([
    Tag("MAIN.pump", "BOOL", address="%QX0.1"), Tag("MAIN.t.Q", "BOOL"),
    Tag("MAIN.t.ET", "TIME", "ns"),
    Tag("OTHER.t.Q", "BOOL"), Tag("MAIN.fill.X", "BOOL"), Tag("MAIN.q", "BOOL"),
    Tag("MAIN.same", "INT", address="%QX0.1")])


@pytest.mark.parametrize(("name", "index"), [
    ("MAIN.pump", 0), ("main.PUMP", 0), ("pump", 0), (" Pump ", 0), ("%QX0.1", 0), ("%qx0.1", 0),
    ("main.t.q", 1), ("t.ET", 2), ("et", 2), ("OTHER.t.Q", 3), ("fill.x", 4), ("same", 6)])
def test_a_tag_is_found_by_full_name_ending_or_address(name, index):
    assert TABLE.find(name) == index
    assert name in TABLE
    assert TABLE[name] is TABLE[index]


def test_a_variable_is_meant_rather_than_the_output_of_a_timer_with_its_name():
    assert TABLE.find("q") == 5


def test_an_ending_of_several_equally_deep_names_is_refused_with_the_choice():
    with pytest.raises(UnknownNameError,
                       match=r"'t\.Q' is not unique; write one of MAIN\.t\.Q, OTHER\.t\.Q"):
        TABLE.find("t.Q")


@pytest.mark.parametrize(("name", "hint"), [
    ("pumpe", "did you mean 'pump'"), ("MAIN.pum", "did you mean 'MAIN.pump'"), ("zzz", "'zzz'$"),
    ("", "there is no tag ''")])
def test_an_unknown_name_is_refused_with_the_nearest_one(name, hint):
    with pytest.raises(UnknownNameError, match=hint):
        TABLE.find(name)
    assert name not in TABLE


def test_two_tags_of_one_name_are_refused():
    table = TagTable([Tag("a.b", "INT")])
    with pytest.raises(ValueError, match=r"there are two tags 'A\.B'"):
        table.add(Tag("A.B", "INT"))
    assert len(table) == 1


def test_tags_keep_their_order():
    assert [tag.name for tag in TABLE][:2] == ["MAIN.pump", "MAIN.t.Q"]
    assert TABLE.find("MAIN.same") == len(TABLE) - 1
