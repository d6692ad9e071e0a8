"""The page of conformance claims nothing that no test shows."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/conformance.md").read_text("utf-8")
ROWS = [tuple(cell.strip(" `") for cell in line.split("|")[1:-1])
        for line in PAGE.splitlines() if line.startswith("| ") and "status" not in line]
CLAIMS = sorted({test for _, _, status, test in ROWS if status != "no"})


def test_every_row_has_a_feature_and_a_status():
    assert len(ROWS) > 100
    assert {status for _, _, status, _ in ROWS} == {"yes", "partly", "no"}
    assert all(number and feature for number, feature, _, _ in ROWS)


def test_just_the_rows_that_claim_something_name_a_test():
    assert [row for row in ROWS if (row[2] == "no") == bool(row[3])] == []


@pytest.mark.parametrize("claim", CLAIMS)
def test_the_named_test_exists(claim):
    file, _, name = claim.partition("::")
    text = (ROOT / "tests" / file).read_text("utf-8")
    assert re.search(rf"^def {name}\(", text, re.MULTILINE)
