"""The exchange against a reference model: a bit array for each area, and writes in order."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plcemu.base.areas import AREAS, SIZES
from plcemu.base.errors import LimitError
from plcemu.io.exchange import MEMORY, PENDING_LIMIT, Exchange, Extent

# ---------------------------------------------------------------- extents


@given(st.sampled_from(sorted(AREAS)), st.data())
def test_memory_and_image_convert_into_each_other(area, data):
    width = SIZES[area[1]]
    count = data.draw(st.integers(1, 5)) * (8 if area[1] == "X" else 1)
    values = data.draw(st.lists(st.integers(0, 1 if area[1] == "X" else 256**width - 1),
                                min_size=count, max_size=count))
    extent = Extent(area, 16, count, 0)
    raw = b"".join(v.to_bytes(width, "little") for v in values)
    bits = sum(v << i for i, v in enumerate(values)).to_bytes(count // 8 or 1, "little") \
        if area[1] == "X" else b""
    expected = bits or b"".join(v.to_bytes(width, "big") for v in values)
    assert extent.to_image(raw) == expected
    assert extent.to_memory(expected) == raw


@pytest.mark.parametrize(("area", "first", "count", "begin", "end", "part"), [
    ("QX", 8, 24, 2, 3, (16, 8, 108)), ("QX", 8, 24, 0, 99, (8, 24, 100)),
    ("QX", 8, 24, 0, 1, None),
    ("QX", 8, 24, 4, 9, None), ("QW", 2, 4, 4, 8, (2, 2, 100)), ("QW", 2, 4, 7, 9, (3, 2, 102)),
    ("QW", 2, 4, 0, 4, None), ("QL", 0, 2, 15, 16, (1, 1, 108)), ("QB", 3, 5, 4, 6, (4, 2, 101)),
    ("QD", 1, 1, 5, 5, (1, 1, 100)),
])
def test_the_part_of_an_extent_that_some_bytes_touch(area, first, count, begin, end, part):
    found = Extent(area, first, count, 100).part(begin, end)
    assert (found and (found.first, found.count, found.offset)) == part


# ---------------------------------------------------------------- model

EXTENTS = (Extent("IX", 0, 16, 0), Extent("QX", 8, 16, 16), Extent("IW", 1, 3, 32),
           Extent("MD", 0, 2, 40), Extent("ML", 2, 1, 48), Extent("QX", 64, 8, 56))
SIZE = 72
"""Bytes 64 to 71 are variables without an address."""


def element(extent, memory, i):
    width = SIZES[extent.area[1]]
    return memory[extent.offset + i * width:extent.offset + (i + 1) * width]


class Model:
    """What the exchange promises, element by element and bit by bit."""

    def __init__(self):
        self.memory = bytearray(SIZE)
        self.image = {area: bytearray(size) for area, size in AREAS.items()}
        self.queue = []
        self.forces = {}

    def read(self, port, area, offset, n):
        view = bytearray(self.memory if area == MEMORY else self.image[area])
        for who, where, at, data, mask in self.queue:
            self.put(view, at, data, mask) if (who, where) == (port, area) else None
        return bytes(view[offset:offset + n])

    @staticmethod
    def put(target, at, data, mask):
        for i, byte in enumerate(data):
            bits = mask[i] if mask is not None else 255
            target[at + i] = (target[at + i] & ~bits) | (byte & bits)

    @staticmethod
    def touched(extent, begin, end):
        """The elements that bytes [begin, end) of the area's image touch."""
        width = 1 / 8 if extent.area[1] == "X" else SIZES[extent.area[1]]
        return [i for i in range(extent.count)
                if begin < math.ceil((extent.first + i + 1) * width)
                and end > math.floor((extent.first + i) * width)]

    def to_image(self, extent, elements):
        width = SIZES[extent.area[1]]
        for i in elements:
            raw, number = element(extent, self.memory, i), extent.first + i
            if extent.area[1] == "X":
                bit = 1 << number % 8
                self.put(self.image[extent.area], number // 8, [bit * (raw != b"\0")], [bit])
            else:
                self.put(self.image[extent.area], number * width, raw[::-1], None)

    def to_memory(self, extent, elements):
        width, image = SIZES[extent.area[1]], self.image[extent.area]
        for i in elements:
            number, at = extent.first + i, extent.offset + i * width
            raw = [image[number // 8] >> number % 8 & 1] if extent.area[1] == "X" else \
                image[number * width:(number + 1) * width][::-1]
            self.memory[at:at + width] = bytes(raw)

    def latch(self):
        for _, area, at, data, mask in self.queue:
            if area == MEMORY:
                self.put(self.memory, at, data, mask)
                continue
            parts = [(e, self.touched(e, at, at + len(data))) for e in EXTENTS if e.area == area]
            for extent, elements in parts:
                self.to_image(extent, elements)
            self.put(self.image[area], at, data, mask)
            for extent, elements in parts:
                self.to_memory(extent, elements)
        self.queue = []
        self.force()

    def force(self):
        for offset, data in self.forces.items():
            self.memory[offset:offset + len(data)] = data

    def publish(self):
        self.force()
        for extent in EXTENTS:
            self.to_image(extent, range(extent.count))


areas = st.sampled_from(["IX", "QX", "IW", "MD", "ML", "QW", MEMORY])
stretches = st.tuples(areas, st.integers(0, 24), st.binary(min_size=1, max_size=6)).map(
    lambda s: (s[0], 64 + s[1] % 3, s[2]) if s[0] == MEMORY else s)
ports = st.integers(0, 1)
writes = st.tuples(st.just("write"), ports, stretches,
                   st.none() | st.binary(min_size=6, max_size=6))
reads = st.tuples(st.just("read"), ports, stretches, st.none())
forces = st.tuples(st.just("force"), st.integers(0, 15), st.booleans(), st.none())
unforces = st.tuples(st.just("unforce"), st.integers(0, 15), st.none(), st.none())
program = st.tuples(st.just("program"), st.integers(0, 31), st.integers(0, 1), st.none())
simple = [st.tuples(st.just(name), st.none(), st.none(), st.none()) for name in ("latch",
                                                                                 "publish")]
actions = st.lists(st.one_of(writes, reads, forces, unforces, program, *simple), max_size=30)


def both(memory, exchange, clients, model, action):
    """Do one action on both, and compare what they answer."""
    name, who, what, mask = action
    if name == "write":
        area, offset, data = what
        cut = None if mask is None else mask[:len(data)]
        clients[who].write(area, offset, data, cut)
        model.queue.append((who, area, offset, data, cut))
    elif name == "read":
        area, offset, data = what
        assert clients[who].read(area, offset, len(data)) == model.read(who, area, offset,
                                                                        len(data))
    elif name == "force":
        exchange.force(who, bytes([what]))
        model.forces[who] = bytes([what])
    elif name == "unforce":
        exchange.unforce(who)
        model.forces.pop(who, None)
    elif name == "program":
        memory[who] = model.memory[who] = what
    elif name == "latch":
        exchange.update_inputs()
        model.latch()
    else:
        exchange.update_outputs()
        model.publish()


@given(actions)
@settings(max_examples=200, deadline=None)
def test_any_sequence_of_reads_writes_forces_and_scans_behaves_like_the_model(sequence):
    memory = bytearray(SIZE)
    exchange, model = Exchange(memory, EXTENTS), Model()
    clients = [exchange.port("one"), exchange.port("two")]
    for action in [*sequence, ("latch", None, None, None), ("publish", None, None, None)]:
        both(memory, exchange, clients, model, action)
        assert exchange.waiting == len(model.queue)
    assert memory == model.memory
    assert {a: bytes(exchange.published(a, 0, n)) for a, n in AREAS.items()} == {
        a: bytes(i) for a, i in model.image.items()}


# ---------------------------------------------------------------- promises in words


def fresh():
    memory = bytearray(SIZE)
    return memory, Exchange(memory, EXTENTS)


def test_a_write_is_seen_by_its_writer_at_once_and_by_others_after_the_scan():
    _, exchange = fresh()
    one, two = exchange.port("one"), exchange.port("two")
    one.write("QX", 1, b"\x01")
    assert (one.read("QX", 1, 1), two.read("QX", 1, 1)) == (b"\x01", b"\x00")
    exchange.update_inputs()
    assert two.read("QX", 1, 1) == b"\x01"


def test_the_later_of_two_writes_wins_whoever_made_them():
    memory, exchange = fresh()
    exchange.port("one").write("IW", 2, b"\x00\x01")
    exchange.port("two").write("IW", 2, b"\x00\x02")
    exchange.update_inputs()
    assert memory[32] == 2


def test_masked_writes_of_two_clients_to_one_byte_both_take_effect():
    memory, exchange = fresh()
    exchange.port("one").write("IX", 0, b"\xff", b"\x01")
    exchange.port("two").write("IX", 0, b"\xff", b"\x80")
    exchange.update_inputs()
    assert list(memory[:8]) == [1, 0, 0, 0, 0, 0, 0, 1]


def test_a_write_to_memory_and_one_to_its_neighbour_in_the_image_both_take_effect():
    memory, exchange = fresh()
    client = exchange.port("one")
    client.write(MEMORY, 0, b"\x01")
    client.write("IX", 0, b"\x02", b"\x02")
    exchange.update_inputs()
    assert list(memory[:3]) == [1, 1, 0]


def test_an_output_that_the_program_writes_again_overrides_a_client():
    memory, exchange = fresh()
    exchange.port("one").write("QX", 1, b"\x01")
    exchange.update_inputs()
    memory[16] = 0
    exchange.update_outputs()
    assert exchange.published("QX", 1, 1) == b"\x00"


def test_addresses_that_the_program_does_not_use_keep_what_clients_write():
    _, exchange = fresh()
    exchange.port("one").write("QW", 100, b"\xab\xcd")
    exchange.update_inputs()
    exchange.update_outputs()
    assert exchange.published("QW", 100, 2) == b"\xab\xcd"


def test_a_write_after_memory_was_restored_keeps_the_restored_neighbours():
    memory, exchange = fresh()
    memory[16:24] = b"\x01" * 8
    exchange.port("one").write("QX", 1, b"\x00", b"\x01")
    exchange.update_inputs()
    assert list(memory[16:24]) == [0, 1, 1, 1, 1, 1, 1, 1]


def test_a_force_holds_against_program_and_clients_until_it_ends():
    memory, exchange = fresh()
    exchange.force(16, b"\x01")
    exchange.port("one").write("QX", 1, b"\x00")
    exchange.update_inputs()
    memory[16] = 0
    exchange.update_outputs()
    assert (exchange.published("QX", 1, 1), exchange.forces) == (b"\x01", {16: b"\x01"})
    exchange.unforce(16)
    memory[16] = 0
    exchange.update_outputs()
    assert (exchange.published("QX", 1, 1), exchange.forces) == (b"\x00", {})


def test_the_writers_of_inputs_are_known_until_the_next_latch():
    _, exchange = fresh()
    exchange.port("plant").write("IW", 0, b"\0\1")
    exchange.port("panel").write("QW", 0, b"\0\1")
    exchange.update_inputs()
    assert exchange.writers == {"plant"}
    exchange.update_inputs()
    assert exchange.writers == set()


@pytest.mark.parametrize(("area", "offset", "data", "mask", "error"), [
    ("IX", 1023, b"12", None, IndexError), ("IX", -1, b"1", None, IndexError),
    ("ZZ", 0, b"1", None, KeyError),
    (MEMORY, SIZE, b"1", None, IndexError), ("IW", 0, b"12", b"1", ValueError)])
def test_a_write_outside_of_its_area_is_refused_and_leaves_nothing(area, offset, data, mask, error):
    _, exchange = fresh()
    with pytest.raises(error):
        exchange.port("one").write(area, offset, data, mask)
    assert exchange.waiting == 0


def test_a_read_outside_of_its_area_is_refused():
    _, exchange = fresh()
    with pytest.raises(IndexError):
        exchange.port("one").read("ML", 8 * 1024 - 1, 2)


def test_a_force_outside_of_memory_is_refused():
    _, exchange = fresh()
    with pytest.raises(IndexError):
        exchange.force(SIZE - 1, b"12")


def test_only_so_many_writes_may_wait():
    _, exchange = fresh()
    client = exchange.port("one")
    for _ in range(PENDING_LIMIT):
        client.write("IX", 0, b"\x01")
    with pytest.raises(LimitError, match="no more are taken"):
        client.write("IX", 0, b"\x00")
    assert client.read("IX", 0, 1) == b"\x01"
    exchange.update_inputs()
    client.write("IX", 0, b"\x00")
    assert exchange.waiting == 1
