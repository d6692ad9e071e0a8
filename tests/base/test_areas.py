"""Addresses of directly represented variables (IEC 61131-3, 2.4.1.1)."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plcemu.base.areas import AREAS, Address, parse_address


@pytest.mark.parametrize(("text", "area", "index"), [
    ("%IX0.0", "IX", 0), ("%IX1023.7", "IX", 8191), ("%Q0.3", "QX", 3), ("%qx2.5", "QX", 21),
    ("%MW12", "MW", 12),
    ("%IB1023", "IB", 1023), ("%MD7", "MD", 7), ("%QL0", "QL", 0), ("%IX4", "IX", 32),
    (" %MX0.1 ", "MX", 1)])
def test_an_address_is_read(text, area, index):
    assert parse_address(text) == Address(area, index)


@given(st.sampled_from(sorted(AREAS)), st.integers(0, 1023), st.integers(0, 7))
def test_a_written_address_reads_back(area, element, bit):
    address = Address(area, element * 8 + bit if area[1] == "X" else element)
    assert parse_address(str(address)) == address


@pytest.mark.parametrize(("text", "message"), [
    ("%IX0.8", "no such bit"), ("%IX1024.0", "outside the process image"), ("%MW1024", "outside"),
    ("%Q5", "names no size"), ("%MW3.1", "only X areas have bits"), ("%ZX0.0", "not an address"),
    ("%IX", "not an address"), ("IX0.0", "not an address"), ("%IX0.0.0", "not an address"),
    ("%IX-1", "not an address"), ("", "not an address"), ("%IX٣.٠", "not an address"),
    ("%IW" + "9" * 50, "outside")])
def test_what_is_no_address_is_refused(text, message):
    with pytest.raises(ValueError, match=message):
        parse_address(text)


def test_every_location_and_size_is_an_area_of_its_own():
    assert {a: AREAS[a] for a in ("IX", "QB", "MW", "ID", "QL")} == {
        "IX": 1024, "QB": 1024, "MW": 2048, "ID": 4096, "QL": 8192}
    assert len(AREAS) == 15
