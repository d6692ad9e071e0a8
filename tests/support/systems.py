"""Systems under test: configurations as text, and the batch plant as it is shipped."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from plcemu.runtime.config import Config, load_config
from plcemu.runtime.system import System

ROOT = Path(__file__).parents[2]
BATCH = ROOT / "il_programs" / "batch_plant"

S, MS = 1_000_000_000, 1_000_000

STARTER = """PROGRAM MAIN
VAR start AT %IX0.0 : BOOL; pump AT %QX0.0 : BOOL; level AT %IW1 : INT; speed AT %QW1 : INT; END_VAR
VAR delay : TON; count : INT; pause : TIME := T#2s; ratio : REAL; END_VAR
  CAL delay(IN := start, PT := pause)
  LD  delay.Q
  ST  pump
  LD  start
  JMPCN done
  LD  count
  ADD 1
  ST  count
done:
  LD  level
  ST  speed
  LD  ratio
  ST  ratio
END_PROGRAM
"""
"""A pump that starts `pause` after `start`; `count` counts the scans with `start` on."""


def write_config(folder: Path, text: str, program: str = STARTER) -> Path:
    """Write `config.yaml` and `main.il` into a folder; return the configuration's path."""
    (folder / "main.il").write_text(program, encoding="utf-8")
    path = folder / "config.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def system_of(folder: Path, text: str = "", program: str = STARTER, *,
              with_plant: bool = True) -> System:
    """Return the system of a configuration whose program is `program`."""
    path = write_config(folder, f"program: main.il\n{text}", program)
    return System(load_config(path), with_plant)


def batch_config(*overrides: str) -> Config:
    """Return the batch plant's configuration with `NAME=VALUE` overrides."""
    return load_config(BATCH, overrides)


def batch_system(*overrides: str, **options: Any) -> System:
    """Return the batch plant's system with `NAME=VALUE` overrides."""
    return System(batch_config(*overrides), **options)
