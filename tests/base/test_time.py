"""Durations as text, and the clock that jumps."""

import asyncio

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plcemu.base.time import DurationError, VirtualClock, format_duration, parse_duration_ns


@pytest.mark.parametrize(("text", "expected"), [
    ("10ms", 10_000_000), ("1.5s", 1_500_000_000), ("T#1s500ms", 1_500_000_000),
    ("t#5s", 5 * 10**9),
    ("TIME#2m", 120 * 10**9), ("LTIME#7ns", 7), ("lt#1us", 1000), ("1h 30min", 5400 * 10**9),
    ("1d2h3m4s5ms6us7ns", 93784005006007), ("T#1d_2h", 93600 * 10**9), ("1_000ms", 10**9),
    ("-2s", -2 * 10**9), ("T#-2s", -2 * 10**9), ("0s", 0), ("0.000000001s", 1), ("3µs", 3000),
    (" 5S ", 5 * 10**9), (42, 42), (-7, -7)])
def test_a_duration_is_read_as_nanoseconds(text, expected):
    assert parse_duration_ns(text) == expected


@pytest.mark.parametrize("text",
                         ["", "5", "s", "5x", "5 s 3", "T#", "1.s", ".5s", "--5s", "5s-3s", "1e3s",
                                  "0.1ns", "1.0000000001s", 1.5, True, "T#T#5s", "5s 5", "٣s"])
def test_what_is_no_duration_is_refused(text):
    with pytest.raises(DurationError, match="is not a duration"):
        parse_duration_ns(text)


@given(st.integers(-10**18, 10**18))
def test_a_written_duration_reads_back(t_ns):
    assert parse_duration_ns(format_duration(t_ns)) == t_ns


@pytest.mark.parametrize(("t_ns", "text"), [
    (0, "0s"), (1, "1ns"), (1500, "1.5us"), (20_000_000, "20ms"), (1_500_000_000, "1.5s"),
    (90 * 10**9, "90s"), (-10**9, "-1s"), (1_000_000_001, "1.000000001s")])
def test_a_duration_is_written_shortly(t_ns, text):
    assert format_duration(t_ns) == text


def test_the_virtual_clock_jumps_forwards_and_never_back():
    clock = VirtualClock()
    asyncio.run(clock.sleep_until_ns(500))
    asyncio.run(clock.sleep_until_ns(300))
    assert clock.now_ns() == 500
