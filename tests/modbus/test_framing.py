"""MBAP framing: fragments, pipelines and headers that cannot be right."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plcemu.modbus import ProtocolError
from plcemu.modbus.framing import Adu, MbapDecoder, encode

adus = st.builds(Adu, st.integers(0, 65535), st.integers(0, 255),
                 st.binary(min_size=1, max_size=253))


def all_ready(decoder: MbapDecoder) -> list[Adu]:
    return list(iter(decoder.next_adu, None))


def test_an_adu_is_its_header_and_its_pdu() -> None:
    adu = Adu(0x1501, 0xFF, bytes.fromhex("03020005"))
    assert encode(adu) == bytes.fromhex("1501 0000 0005 ff 03020005")


@given(st.lists(adus, max_size=8), st.data())
def test_any_fragments_of_a_pipeline_give_the_same_adus(sent: list[Adu],
                                                        data: st.DataObject) -> None:
    stream = b"".join(map(encode, sent))
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=12)))
    decoder, received = MbapDecoder(), []
    for low, high in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        decoder.receive_data(stream[low:high])
        received += all_ready(decoder)
    assert received == sent
    assert decoder.pending == 0


@given(adus)
def test_byte_by_byte_an_adu_is_ready_with_its_last_byte(adu: Adu) -> None:
    decoder, stream = MbapDecoder(), encode(adu)
    for i in range(len(stream) - 1):
        decoder.receive_data(stream[i:i + 1])
        assert not decoder.is_ready
    assert decoder.next_adu() is None
    decoder.receive_data(stream[-1:])
    assert decoder.is_ready
    assert decoder.next_adu() == adu


@pytest.mark.parametrize("protocol, length, text", [
    (1, 6, "protocol identifier 1"),
    (0xFFFF, 6, "protocol identifier 65535"),
    (0, 0, "length field 0, not 2 to 254"),
    (0, 1, "length field 1, not 2 to 254"),
    (0, 255, "length field 255, not 2 to 254"),
    (0, 65535, "length field 65535, not 2 to 254"),
])
def test_an_impossible_header_is_told_as_soon_as_it_is_seen_and_for_ever(
        protocol: int, length: int, text: str) -> None:
    decoder = MbapDecoder()
    decoder.receive_data(struct.pack(">HHH", 7, protocol, length))
    assert decoder.is_ready
    with pytest.raises(ProtocolError, match=text):
        decoder.next_adu()
    decoder.receive_data(encode(Adu(1, 1, b"\x01")))
    with pytest.raises(ProtocolError, match=text):
        decoder.next_adu()


def test_adus_before_an_impossible_header_are_still_given() -> None:
    decoder = MbapDecoder()
    decoder.receive_data(encode(Adu(1, 1, b"\x07")) + b"GET / HTTP/1.1\r\n")
    assert decoder.next_adu() == Adu(1, 1, b"\x07")
    with pytest.raises(ProtocolError):
        decoder.next_adu()


@pytest.mark.parametrize("size", [1, 253])
def test_the_shortest_and_the_longest_pdu_pass(size: int) -> None:
    decoder = MbapDecoder()
    decoder.receive_data(encode(Adu(1, 0, bytes(size))))
    assert decoder.next_adu() == Adu(1, 0, bytes(size))
