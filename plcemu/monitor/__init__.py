"""Temporal properties over traces, judged online at the earliest instant.

Knows only `plcemu.base`: it judges any trace, also one recorded from a real plant.
"""

from plcemu.monitor.parse import (
    Property,
    Severity,
    load_properties,
    parse_formula,
    parse_properties,
    parse_property,
)
from plcemu.monitor.suite import Monitor, Suite, judge
from plcemu.monitor.verdict import Result, Verdict, Violation

__all__ = [
    "Monitor",
    "Property",
    "Result",
    "Severity",
    "Suite",
    "Verdict",
    "Violation",
    "judge",
    "load_properties",
    "parse_formula",
    "parse_properties",
    "parse_property",
]
