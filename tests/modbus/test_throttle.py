"""Log lines about peers' mistakes are limited in number."""

from __future__ import annotations

import logging

import pytest

from plcemu.modbus.throttle import Throttle


def test_one_line_of_a_kind_passes_in_an_interval_and_the_next_tells_how_many_did_not(
        caplog: pytest.LogCaptureFixture) -> None:
    now_s = [0.0]
    throttle = Throttle(5.0, lambda: now_s[0])
    for t_s, kind in ((0.0, "a"), (1.0, "a"), (2.0, "b"), (4.9, "a"), (5.0, "a"), (10.0, "a")):
        now_s[0] = t_s
        throttle.log(logging.WARNING, kind, f"{kind} at {t_s}")
    assert [r.message for r in caplog.records] == [
        "a at 0.0", "b at 2.0", "a at 5.0 (and 2 more of this kind)", "a at 10.0"]
