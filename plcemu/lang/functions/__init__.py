"""The standard functions (IEC 61131-3, tables 22 to 30): one table, each row a way to lower a call.

Most are another spelling of operators and are rewritten to them. The others bring their own type
rule and code.
"""

from __future__ import annotations

from plcemu.base.types import ELEMENTARY
from plcemu.lang.functions import numbers, selection, strings, times
from plcemu.lang.functions.conversions import find_conversion, near_conversions
from plcemu.lang.functions.rows import MANY, Standard, arguments_fit

__all__ = ["MANY", "NAMES", "Standard", "arguments_fit", "find", "near_conversions"]

_TABLE: dict[str, Standard] = {row.name: row for row in (
    *numbers.ROWS, *selection.ROWS, *strings.ROWS, *times.ROWS)}

NAMES: frozenset[str] = frozenset(name for name in _TABLE if not name.startswith("__"))
"""The functions that are in the table; conversions come on top, see `find`."""


def find(name: str) -> Standard | None:
    """Return the standard function of that name, or None.

    Beside the overloaded name there is one for each type, such as ADD_INT (2.5.1.4).
    """
    key = name.upper()
    found = _TABLE.get(key) or find_conversion(key)
    if found is None:
        base, _, of = key.rpartition("_")
        found = _TABLE.get(base) if of in ELEMENTARY or of in ("STRING", "WSTRING") else None
    return found
