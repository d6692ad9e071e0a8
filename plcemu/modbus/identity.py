"""What a device tells about itself: function code 43/14 (application protocol, section 6.21)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

OBJECT_BYTES = 244
"""The longest object that still fits alone into a response PDU of 253 bytes."""

BASIC_OBJECTS = range(0x03)
REGULAR_OBJECTS = range(0x80)
EXTENDED_OBJECTS = range(0x80, 0x100)


RUN_OBJECT = 0x80
"""The private object in which a server shows the run of the PLC behind it: another start, another
text. So a client that was away can tell whether it meets the same run."""


@dataclass(frozen=True, slots=True)
class Identity:
    """The identification objects of one server, as ASCII texts.

    The first three are mandatory and always shown; another one that is empty is not shown.

    Attributes:
        extended: private objects by id, 0x80 to 0xFF.

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
    extended: Mapping[int, str] = field(default_factory=dict)
    objects: Mapping[int, bytes] = field(init=False, repr=False, compare=False)
    """The shown objects by id, in rising order."""

    def __post_init__(self) -> None:
        texts = dict(enumerate((self.vendor, self.product_code, self.revision, self.url,
                                self.product_name, self.model_name, self.application_name)))
        for number in sorted(self.extended):
            if number not in EXTENDED_OBJECTS:
                raise ValueError(f"identification object {number:#04x} is not private; "
                                 "private ids go from 0x80 to 0xff")
            texts[number] = self.extended[number]
        shown = {number: _object(number, text) for number, text in texts.items()
                 if text or number in BASIC_OBJECTS}
        object.__setattr__(self, "objects", shown)

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
