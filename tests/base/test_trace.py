"""Frames and traces: values hold until the next frame."""

import pytest

from plcemu.base.errors import LimitError, UnknownNameError
from plcemu.base.tags import Tag, TagTable
from plcemu.base.trace import Frame, Trace

TAGS = TagTable([Tag("MAIN.a", "BOOL"), Tag("MAIN.n", "INT")])
FRAMES = [Frame(0, 0, ((0, False), (1, 5))), Frame(10, 1, ()), Frame(20, 2, ((1, 6),)),
          Frame(30, 3, ((0, True), (1, 7))), Frame(50, 5, ())]


def recorded(**options):
    trace = Trace(TAGS, **options)
    for frame in FRAMES:
        trace.observe(frame)
    return trace


def test_frames_without_changes_are_not_kept_but_move_the_end():
    trace = recorded()
    assert [frame.t_ns for frame in trace.frames] == [0, 20, 30]
    assert trace.end_ns == 50


def test_the_first_frame_is_kept_even_if_it_is_empty():
    trace = Trace(TagTable())
    trace.observe(Frame(0, 0, ()))
    assert len(trace.frames) == 1


def test_values_accumulate():
    assert [(t, dict(values)) for t, values in recorded().values()] == [
        (0, {0: False, 1: 5}), (20, {0: False, 1: 6}), (30, {0: True, 1: 7})]


def test_the_history_of_a_tag_has_its_changes_only():
    assert recorded().history("a") == [(0, False), (30, True)]
    assert recorded().history("MAIN.N") == [(0, 5), (20, 6), (30, 7)]
    with pytest.raises(UnknownNameError):
        recorded().history("b")


def test_a_full_trace_says_so():
    with pytest.raises(LimitError, match=r"the trace is full \(2 frames\)"):
        recorded(limit=2)
