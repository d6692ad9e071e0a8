"""What a device tells about itself: function code 43/14 (application protocol, section 6.21)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

OBJECT_BYTES = 244
"""The longest object that still fits alone into a response PDU of 253 bytes."""

BASIC_OBJECTS = range(0x03)
REGULAR_OBJECTS = range(0x80)
EXTENDED_OBJECTS = range(0x80, 0x100)


RUN_OBJECT = 0x80
"""The private object in which a server shows the run of the PLC behind it: another start, another
text. So a client that was away can tell whether it meets the same run."""

STATE_OBJECT = 0x81
"""The private object that tells the state of the PLC now: RUN, STOP or FAULT."""

FAULT_OBJECT = 0x82
"""The private object that tells why the PLC is in FAULT; it is shown only then."""


@dataclass(frozen=True, slots=True)
class Identity:
    """The identification objects of one server, as ASCII texts.

    The first three are mandatory and always shown; another one that is empty is not shown.

    Attributes:
        extended: private objects by id, 0x80 to 0xFF. One may be a function, which is asked for
            the text of every answer; what is not ASCII in it becomes `?`, what is too long is cut.

    Raises:
        ValueError: a text is not ASCII or too long (`OBJECT_BYTES`), or an id is not private.
    """

    vendor: str = "plcemu"
    product_code: str = "plcemu"
    revision: str = "0"
    url: str = ""
    product_name: str = ""
    model_name: str = ""
    application_name: str = ""
    extended: Mapping[int, str | Callable[[], str]] = field(default_factory=dict)
    _fixed: Mapping[int, bytes] = field(init=False, repr=False, compare=False)
    _live: Mapping[int, Callable[[], str]] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        texts: dict[int, str] = dict(enumerate((
            self.vendor, self.product_code, self.revision, self.url,
            self.product_name, self.model_name, self.application_name)))
        for number in self.extended:
            if number not in EXTENDED_OBJECTS:
                raise ValueError(f"identification object {number:#04x} is not private; "
                                 "private ids go from 0x80 to 0xff")
        live = {n: text for n, text in self.extended.items() if not isinstance(text, str)}
        texts |= {n: text for n, text in self.extended.items() if isinstance(text, str)}
        fixed = {number: _object(number, text) for number, text in sorted(texts.items())
                 if text or number in BASIC_OBJECTS}
        object.__setattr__(self, "_fixed", fixed)
        object.__setattr__(self, "_live", live)

    @property
    def objects(self) -> Mapping[int, bytes]:
        """The objects shown now by id, in rising order."""
        if not self._live:
            return self._fixed
        live = {n: text().encode("ascii", "replace")[:OBJECT_BYTES]
                for n, text in self._live.items()}
        shown = {**self._fixed, **{n: text for n, text in live.items() if text}}
        return dict(sorted(shown.items()))

    @property
    def conformity_level(self) -> int:
        """The highest category shown: 1 basic, 2 regular, 3 extended; with 0x80 also one by one."""
        last = max(self.objects)
        return 0x80 | (1 + (last not in BASIC_OBJECTS) + (last not in REGULAR_OBJECTS))


def _object(number: int, text: str) -> bytes:
    if not text.isascii() or len(text) > OBJECT_BYTES:
        raise ValueError(f"identification object {number:#04x} must be at most {OBJECT_BYTES} "
                         f"ASCII characters, not {text!r}")
    return text.encode("ascii")
