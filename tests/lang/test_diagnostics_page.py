"""The page of diagnostics explains every code, and its examples are true."""

import re
from pathlib import Path

import pytest

from plcemu.base.errors import CompileError
from plcemu.lang.codes import CODES
from plcemu.lang.compile import compile_program

PAGE = (Path(__file__).parents[2] / "docs/diagnostics.md").read_text("utf-8")
SECTIONS = {part[:5]: part for part in re.split(r"^## ", PAGE, flags=re.MULTILINE)[1:]}
EXAMPLES = {code: found for code, part in SECTIONS.items()
            if (found := re.findall(r"```iecst\n(.*?)\n```", part, re.DOTALL))}
WITHOUT_A_TEXT = {"P0080", "P0090"}
"""A file that cannot be read, and what no version promises to leave out."""


def codes_of(text):
    try:
        return {d.code for d in compile_program(text).warnings}
    except CompileError as error:
        return {d.code for d in error.diagnostics}


def test_every_code_has_a_section_headed_by_what_it_means():
    assert {code: part.split("\n")[0][7:] for code, part in SECTIONS.items()} == CODES


def test_every_code_that_a_text_can_have_has_a_wrong_and_a_right_one():
    assert {code: len(texts) for code, texts in EXAMPLES.items()} \
        == dict.fromkeys(sorted(CODES.keys() - WITHOUT_A_TEXT), 2)


@pytest.mark.parametrize("code", EXAMPLES)
def test_the_wrong_text_gives_just_its_code_and_the_right_one_none(code):
    wrong, right = EXAMPLES[code]
    assert codes_of(wrong) == {code}
    assert codes_of(right) == set()
