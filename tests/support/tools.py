"""Programs of other makers that tests use: independent peers and judges."""

from __future__ import annotations

import os
import shutil

import pytest


def need_tool(name: str) -> str:
    """Return the path of a program; without it the test is skipped, in CI it fails."""
    path = shutil.which(name)
    if path is None and os.environ.get("CI") == "true":
        pytest.fail(f"{name} is not installed, and CI must have it")
    if path is None:
        pytest.skip(f"{name} is not installed")
    return path


def need_spin() -> None:
    """Skip the test without SPIN and a C compiler, in CI fail."""
    need_tool("spin")
    need_tool("gcc")
