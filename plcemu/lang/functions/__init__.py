"""The standard functions (IEC 61131-3, tables 22 to 30): one table, each row a way to lower a call.

Most are another spelling of operators and are rewritten to them. The others bring their own type
rule and code.
"""

from __future__ import annotations

from plcemu.lang.functions import numbers, selection, strings, times
from plcemu.lang.functions.conversions import find_conversion, near_conversions
from plcemu.lang.functions.rows import MANY, Standard, arguments_fit

__all__ = ["MANY", "NAMES", "Standard", "arguments_fit", "find", "near_conversions"]

_TABLE: dict[str, Standard] = {row.name: row for row in (
    *numbers.ROWS, *selection.ROWS, *strings.ROWS, *times.ROWS)}

NAMES: frozenset[str] = frozenset(name for name in _TABLE if not name.startswith("__"))
"""The functions that are in the table; conversions come on top, see `find`."""


def find(name: str) -> Standard | None:
    """Return the standard function of that name, or None."""
    return _TABLE.get(name.upper()) or find_conversion(name.upper())
