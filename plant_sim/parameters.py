"""Parameters of a plant: a frozen dataclass whose fields know their unit, bounds and meaning.

For example:

    @dataclass(frozen=True)
    class OvenParameters(Parameters):
        power_W: float = parameter(800.0, "heating power", unit="W", low=0.0, high=5000.0)

    OvenParameters.of({"power_W": "950"})       # values may be text, as from a command line
    OvenParameters.table()                      # rows for --help
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any, Self

_ROW = "plant_sim.parameter"
_TRUE, _FALSE = ("true", "yes", "on", "1"), ("false", "no", "off", "0")


class ParameterError(ValueError):
    """A parameter that does not exist or cannot have the value found."""

    def __init__(self, name: str, found: object, expected: str) -> None:
        super().__init__(f"parameter {name}: found {found!r}, expected {expected}")
        self.name = name
        self.found = found
        self.expected = expected


@dataclass(frozen=True, slots=True)
class Parameter:
    """One row of a parameter table; `low` and `high` are included bounds in `unit`.

    `read` replaces the standard reading of a value: it returns the checked value or raises
    ValueError with what was expected.
    """

    name: str
    kind: str
    default: object
    description: str
    unit: str = ""
    low: float | None = None
    high: float | None = None
    allowed: tuple[object, ...] | None = None
    expects: str = ""
    read: Callable[[object], object] | None = None

    @property
    def expected(self) -> str:
        """The admissible values in words."""
        unit = f" {self.unit}" if self.unit else ""
        if self.expects:
            return self.expects
        if self.allowed is not None:
            return "one of " + ", ".join(str(value) for value in self.allowed) + unit
        bounds = [f"at least {self.low:g}{unit}"] if self.low is not None else []
        bounds += [f"at most {self.high:g}{unit}"] if self.high is not None else []
        word = {"float": "a number", "int": "a whole number", "bool": "true or false"}
        return " ".join([word.get(self.kind, "a text"), " and ".join(bounds)]).strip()

    def check(self, found: object) -> object:
        """The value that `found` stands for. Raises ParameterError."""
        if self.read is not None:
            try:
                return self.read(found)
            except ValueError as error:
                raise ParameterError(self.name, found, str(error)) from None
        try:
            value = _READERS[self.kind](found)
        except (ValueError, OverflowError):
            raise ParameterError(self.name, found, self.expected) from None
        if not self._admits(value):
            raise ParameterError(self.name, found, self.expected)
        return value

    def _admits(self, value: object) -> bool:
        if self.allowed is not None:
            return value in self.allowed
        if isinstance(value, int | float):
            low = -math.inf if self.low is None else self.low
            high = math.inf if self.high is None else self.high
            return low <= value <= high
        return True


def _read_bool(found: object) -> bool:
    if isinstance(found, bool):
        return found
    text = str(found).strip().lower()
    if text in _TRUE or text in _FALSE:
        return text in _TRUE
    raise ValueError(text)


def _read_int(found: object) -> int:
    value = _read_float(found)
    if value != int(value):
        raise ValueError(found)
    return int(value)


def _read_float(found: object) -> float:
    if isinstance(found, bool) or not isinstance(found, int | float | str):
        raise ValueError(found)
    value = float(found)
    if not math.isfinite(value):
        raise ValueError(found)
    return value


def _read_text(found: object) -> str:
    if not isinstance(found, str):
        raise ValueError(found)
    return found.strip()


_READERS: dict[str, Callable[[object], object]] = {
    "bool": _read_bool,
    "int": _read_int,
    "float": _read_float,
    "str": _read_text,
}


def parameter(
    default: object,
    description: str,
    *,
    unit: str = "",
    low: float | None = None,
    high: float | None = None,
    allowed: tuple[object, ...] | None = None,
    expects: str = "",
    read: Callable[[object], object] | None = None,
) -> Any:
    """A dataclass field of a `Parameters` class; its kind is the type of `default`."""
    kind = type(default).__name__
    row = Parameter("", kind, default, description, unit, low, high, allowed, expects, read)
    if isinstance(default, dict):
        return field(default_factory=lambda: dict(default), metadata={_ROW: row})
    return field(default=default, metadata={_ROW: row})


@dataclass(frozen=True)
class Parameters:
    """Base of all parameter sets; every value is read and checked on construction."""

    def __post_init__(self) -> None:
        for row in self.table():
            object.__setattr__(self, row.name, row.check(getattr(self, row.name)))

    @classmethod
    def table(cls) -> tuple[Parameter, ...]:
        """All parameters in the order of their declaration."""
        rows = [(item.name, item.metadata[_ROW]) for item in fields(cls)]
        return tuple(_named(row, name) for name, row in rows)

    @classmethod
    def of(cls, values: Mapping[str, object], besides: Iterable[str] = ()) -> Self:
        """The set with these values and defaults elsewhere. Raises ParameterError.

        Args:
            values: by name.
            besides: names of others that may be meant by one that does not exist.
        """
        own = [row.name for row in cls.table()]
        known = [*besides, *own]
        for name, found in values.items():
            if name not in own:
                raise ParameterError(name, found, f"a known parameter: {_suggest(name, known)}")
        return cls(**values)

    def as_dict(self) -> dict[str, Any]:
        """All values by name, ready for JSON."""
        return asdict(self)


def _named(row: Parameter, name: str) -> Parameter:
    rest = (row.unit, row.low, row.high, row.allowed, row.expects, row.read)
    return Parameter(name, row.kind, row.default, row.description, *rest)


def _suggest(name: str, known: list[str]) -> str:
    near = difflib.get_close_matches(name, known, n=1)
    return f"did you mean {near[0]}?" if near else ", ".join(known)
