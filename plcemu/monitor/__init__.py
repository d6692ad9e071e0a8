"""Temporal properties over traces, judged online at the earliest instant.

Knows only `plcemu.base`: it judges any trace, also one recorded from a real plant.
"""

from plcemu.monitor.parse import Property, load_properties, parse_formula, parse_properties
from plcemu.monitor.suite import Monitor, Suite, judge
from plcemu.monitor.verdict import Result, Verdict, Violation

__all__ = [
    "Monitor",
    "Property",
    "Result",
    "Suite",
    "Verdict",
    "Violation",
    "judge",
    "load_properties",
    "parse_formula",
    "parse_properties",
]
