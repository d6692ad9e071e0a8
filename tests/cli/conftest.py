"""Fixtures of the command line's tests."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from systems import write_config

from plcemu.cli.main import main


class Outcome(NamedTuple):
    """What a command left behind."""

    code: int
    out: str
    err: str

    @property
    def document(self) -> Any:
        """The one JSON document on stdout."""
        return json.loads(self.out)


@pytest.fixture
def plcemu(capsys: pytest.CaptureFixture[str]) -> Callable[..., Outcome]:
    """Return a function that runs a command in this process."""
    def run(*arguments: object) -> Outcome:
        capsys.readouterr()
        try:
            code = main([str(a) for a in arguments])
        except SystemExit as end:
            code = int(end.code or 0)
        return Outcome(code, *capsys.readouterr())
    return run


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the working folder, with the configuration of a small program in it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "demands.prop").write_text('calm "the pump rests": G !pump\n', encoding="utf-8")
    write_config(tmp_path, "name: starter\nprogram: main.il\nproperties: demands.prop\n"
                 "modbus: {port: 0}\n")
    return tmp_path


@pytest.fixture(autouse=True)
def quiet_loggers() -> Iterator[None]:
    """Take back what a command set up for its log lines."""
    root = logging.getLogger()
    before = root.handlers[:], root.level
    yield
    root.handlers[:], root.level = before
