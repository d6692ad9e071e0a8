"""Errors and diagnostics tell where, what and what to do."""

import pytest

from plcemu.base.errors import (
    CompileError,
    ConfigError,
    PlcemuError,
    ProgramFault,
    UnknownNameError,
    did_you_mean,
)
from plcemu.base.spans import Diagnostic, Severity, Source, Span

SOURCE = Source("plant.st", "one\n\ttwo größe\r\nthree")


@pytest.mark.parametrize(("offset", "place"), [
    (0, (1, 1)), (3, (1, 4)), (4, (2, 1)), (5, (2, 2)), (14, (2, 11)), (15, (2, 12)), (16, (3, 1)),
    (21, (3, 6))])
def test_a_place_is_counted_in_characters_from_one(offset, place):
    assert SOURCE.position(offset) == place


def test_spans_join_and_print_their_begin():
    joined = Span(SOURCE, 0, 3).to(Span(SOURCE, 5, 8))
    assert (joined.start, joined.end, str(joined), repr(joined)) == (0, 8, "plant.st:1:1",
                                                                     "Span(plant.st:1:1)")


def diagnostic(**options):
    return Diagnostic("P0020", Span(SOURCE, 5, 8), "'two' is not declared", **options)


def test_a_diagnostic_prints_file_line_column_code_message_and_hint():
    assert str(diagnostic()) == "plant.st:2:2: P0020 'two' is not declared"
    assert str(diagnostic(hint="did you mean 'tow'?", severity=Severity.WARNING)) == (
        "plant.st:2:2: P0020 warning: 'two' is not declared (did you mean 'tow'?)")


def test_a_diagnostic_is_plain_values_as_json():
    assert diagnostic().as_json() == {
        "file": "plant.st", "line": 2, "column": 2, "code": "P0020", "severity": "error",
        "message": "'two' is not declared", "hint": ""}


def test_a_compile_error_lists_its_diagnostics_and_tells_errors_from_warnings():
    error = CompileError([diagnostic(), diagnostic(severity=Severity.WARNING)])
    assert (len(error.diagnostics), len(error.errors), len(str(error).splitlines())) == (2, 1, 2)


def test_a_program_fault_reads_as_a_sentence():
    fault = ProgramFault("division by zero", task="fast", pou="MAIN", place="a.st:3:4",
                         t_ns=1_500_000_000)
    assert str(fault) == "division by zero in MAIN at a.st:3:4 (task fast, t = 1.500 s)"
    assert str(ProgramFault("x")) == "x (task -, t = 0.000 s)"


def test_every_error_is_one_that_the_user_can_act_on():
    assert issubclass(UnknownNameError, PlcemuError) and issubclass(UnknownNameError, KeyError)
    assert str(UnknownNameError("tag", "pmp",
                                ["pump"])) == "there is no tag 'pmp'; did you mean 'pump'?"
    assert str(ConfigError(["a", "b"])) == "a\nb"


@pytest.mark.parametrize(("name", "hint"), [
    ("PUMPE", "; did you mean 'Pump'?"), ("xyz", ""), ("", "")])
def test_the_nearest_name_is_offered(name, hint):
    assert did_you_mean(name, ["Pump", "valve"]) == hint
