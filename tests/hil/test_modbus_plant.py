"""The plant as a Modbus client, against our own server on the loopback, in virtual time."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from fractions import Fraction
from typing import Any

import pytest
from lockstep import memory_frames, over_modbus, traced
from systems import S, batch_system
from toy_plant import ToyPlant

from hil.coupling import Coupling, points
from hil.modbus_plant import FieldLinkError, ModbusPlant
from plcemu.io.exchange import Exchange, Port
from plcemu.modbus import AddressMap, Identity, MapRange, ModbusTcpServer, ObjectType
from plcemu.modbus.errors import UnmappedError

SCENARIO_S = 60.0
ONE = Fraction(1)


# the same run both ways


@pytest.mark.parametrize("load", [1, 2])
def test_a_plant_behind_modbus_gives_the_run_of_a_plant_in_the_process(load: int) -> None:
    overrides = (f"load={load}", "port=0", "cycle=100ms")
    inside, outside = batch_system(*overrides), batch_system(*overrides, with_plant=False)
    inside_trace, outside_trace = traced(inside), traced(outside)
    inside.cycle.run_virtual(6000 * S)
    asyncio.run(over_modbus(outside, 6000 * S))
    assert memory_frames(inside, inside_trace) == memory_frames(outside, outside_trace)
    starts = [[(t, n) for n in range(1, 13) for t, on in trace.history(f"P{n}.X") if on]
              for trace in (inside_trace, outside_trace)]
    assert starts[0] == starts[1]
    assert len(starts[0]) > 12


# single exchanges


class Bench:
    """A toy plant, wired, and a server over an empty process image."""

    def __init__(self, inputs: Mapping[str, str], outputs: Mapping[str, str],
                 address_map: AddressMap | None = None, unit: int = 1, **server: Any) -> None:
        self.plant: Any = ToyPlant(dict.fromkeys(inputs, 0.0), outputs)
        self.exchange = Exchange(bytearray())
        self.port: Port = self.exchange.port("test")
        self._map = address_map or AddressMap()
        self._server_settings = server
        self._unit = unit
        wired = {n: (a, ONE) for n, a in inputs.items()}, {n: (a, ONE) for n, a in outputs.items()}
        self.coupling = Coupling(self.plant, points(wired[0], inputs), points(wired[1], outputs))

    async def serve(self, port: int = 0) -> ModbusTcpServer:
        server = ModbusTcpServer(self.exchange, self._map, Identity(), port=port,
                                 **self._server_settings)
        await server.start()
        return server

    def link(self, port: int) -> ModbusPlant:
        return ModbusPlant(self.coupling, self._map, "127.0.0.1", port, self._unit, timeout_s=2.0)

    def set(self, area: str, offset: int, data: bytes) -> None:
        self.port.write(area, offset, data)
        self.exchange.update_inputs()

    def get(self, area: str, offset: int, n: int) -> bytes:
        self.exchange.update_inputs()
        return self.exchange.published(area, offset, n)


def run(bench: Bench, scenario: Callable[[ModbusPlant, ModbusTcpServer], Awaitable[Any]]) -> Any:
    """Run a scenario with a connected link."""
    async def main() -> Any:
        server = await bench.serve()
        link = bench.link(server.port)
        try:
            async with asyncio.timeout(SCENARIO_S):
                await link.connect()
                return await scenario(link, server)
        finally:
            link.close()
            await server.stop()
    return asyncio.run(main())


def test_outputs_of_every_width_are_read() -> None:
    bench = Bench({}, {"isOn": "%QX1.3", "w": "%QW5", "mw": "%QW7"})
    bench.set("QX", 1, b"\x08")
    bench.set("QW", 10, bytes.fromhex("fffe 0000 0102"))

    async def scenario(link: ModbusPlant, _: ModbusTcpServer) -> None:
        await link.exchange(7)
    run(bench, scenario)
    assert bench.plant.told == [(0, {"isOn": True, "w": -2.0, "mw": 258.0})]
    assert bench.plant.t_ns == 7


WIDE = AddressMap([MapRange(ObjectType.HOLDING, 0, 200, "ID", access="rw"),
                   MapRange(ObjectType.HOLDING, 1000, 400, "IL", access="rw"),
                   MapRange(ObjectType.INPUT, 0, 200, "QD"),
                   MapRange(ObjectType.DISCRETE, 100, 80, "QX"),
                   MapRange(ObjectType.HOLDING, 3000, 400, "QL")])


def test_wide_points_travel_high_word_first_and_untorn() -> None:
    bench = Bench({"d": "%ID3", "l": "%IL2"}, {"qd": "%QD1", "ql": "%QL1", "isOn": "%QX0.2"}, WIDE)
    bench.plant.readings |= {"d": -2, "l": 0x0102030405060708}
    bench.set("QD", 4, bytes.fromhex("fffffffd"))
    bench.set("QL", 8, bytes.fromhex("0000000100000000"))
    bench.set("QX", 0, b"\x04")

    async def scenario(link: ModbusPlant, _: ModbusTcpServer) -> None:
        await link.exchange(0)
    run(bench, scenario)
    assert bench.get("ID", 12, 4) == bytes.fromhex("fffffffe")
    assert bench.get("IL", 16, 8) == bytes.fromhex("0102030405060708")
    assert bench.plant.told == [(0, {"qd": -3.0, "ql": float(2**32), "isOn": True})]


def test_neighbours_share_a_request_and_only_changes_are_written() -> None:
    inputs = {f"s{n}": f"%IW{n}" for n in range(4)} | {"far": "%IW100"}
    bench = Bench(inputs, {"a": "%QW0", "b": "%QW9", "c": "%QW400"})

    async def scenario(link: ModbusPlant, server: ModbusTcpServer) -> list[int]:
        counts = []
        for value in (0.0, 0.0, 5.0):
            bench.plant.readings["far"] = value
            before = server.counters["requests"]
            await link.exchange(0)
            counts.append(server.counters["requests"] - before)
        return counts
    assert run(bench, scenario) == [4, 2, 3]


def test_numbers_between_wired_inputs_are_left_alone() -> None:
    bench = Bench({"a": "%IW0", "b": "%IW2", "isA": "%IX0.0", "isB": "%IX0.2"}, {})
    bench.set("IW", 2, b"\0\7")
    bench.set("IX", 0, b"\x02")
    bench.plant.readings |= {"a": 1, "b": 2, "isA": True, "isB": True}

    async def scenario(link: ModbusPlant, _: ModbusTcpServer) -> None:
        await link.exchange(0)
    run(bench, scenario)
    assert bench.get("IW", 0, 6) == bytes.fromhex("0001 0007 0002")
    assert bench.get("IX", 0, 1) == b"\x07"


def test_more_points_than_a_request_may_hold_are_split() -> None:
    numbers = range(300)
    bench = Bench({f"s{n}": f"%IW{n}" for n in numbers}, {f"q{n}": f"%QW{n}" for n in numbers})
    bench.plant.readings |= {f"s{n}": float(n) for n in range(300)}

    async def scenario(link: ModbusPlant, server: ModbusTcpServer) -> int:
        await link.exchange(0)
        return server.counters["requests"]
    assert run(bench, scenario) == 3 + 3
    assert bench.get("IW", 598, 2) == (299).to_bytes(2, "big")


def test_on_demand_all_inputs_are_written_again() -> None:
    bench = Bench({"a": "%IW0"}, {})

    async def scenario(link: ModbusPlant, server: ModbusTcpServer) -> list[int]:
        await link.exchange(0)
        first = server.counters["requests"]
        await link.exchange(0)
        second = server.counters["requests"]
        await link.exchange(0, everything=True)
        return [first, second, server.counters["requests"]]
    assert run(bench, scenario) == [1, 1, 2]


# outages


def test_without_a_server_there_is_no_connection() -> None:
    bench = Bench({"a": "%IW0"}, {})

    async def scenario() -> None:
        server = await bench.serve()
        await server.stop()
        link = bench.link(server.port)
        with pytest.raises(FieldLinkError, match=f"no Modbus server answers at .*:{server.port}"):
            await link.connect()
        with pytest.raises(FieldLinkError, match="not connected"):
            await link.exchange(0)
    asyncio.run(scenario())


def test_after_an_outage_all_inputs_are_sent_again() -> None:
    bench = Bench({"a": "%IW0"}, {"q": "%QW0"})
    bench.plant.readings["a"] = 7

    async def scenario() -> None:
        server = await bench.serve()
        link = bench.link(server.port)
        await link.connect()
        await link.exchange(0)
        await server.stop()
        with pytest.raises(FieldLinkError):
            await link.exchange(1)
        bench.set("IW", 0, b"\0\0")
        server = await bench.serve(server.port)
        await link.connect()
        await link.exchange(2)
        link.close()
        await server.stop()
    asyncio.run(scenario())
    assert bench.get("IW", 0, 2) == b"\0\7"


def test_another_unit_is_refused_and_told() -> None:
    bench = Bench({"a": "%IW0"}, {"q": "%QW0"}, unit=9, units=[1])

    async def scenario(link: ModbusPlant, _: ModbusTcpServer) -> None:
        with pytest.raises(FieldLinkError, match=(
                r"reading holding registers 0 to 0: unit 9 refused with exception 11 "
                r"\(gateway target failed to respond\)")):
            await link.exchange(0)
    run(bench, scenario)


def test_an_address_that_the_plc_does_not_have_is_told() -> None:
    bench = Bench({"a": "%IW0"}, {})

    async def scenario() -> None:
        server = ModbusTcpServer(bench.exchange, AddressMap(field_window=False), Identity(), port=0)
        await server.start()
        link = bench.link(server.port)
        await link.connect()
        with pytest.raises(FieldLinkError, match=(
                r"writing holding registers 16384 to 16384: unit 1 refused with exception 2 "
                r"\(illegal data address\)")):
            await link.exchange(0)
        link.close()
        await server.stop()
    asyncio.run(scenario())


def test_a_server_that_talks_nonsense_is_an_outage() -> None:
    bench = Bench({}, {"q": "%QW0"})

    async def nonsense(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.read(100)
        writer.write(b"HTTP/1.1 400 Bad Request\r\n\r\n")
        writer.close()

    async def scenario() -> None:
        server = await asyncio.start_server(nonsense, "127.0.0.1", 0)
        link = bench.link(server.sockets[0].getsockname()[1])
        await link.connect()
        with pytest.raises(FieldLinkError):
            await link.exchange(0)
        link.close()
        server.close()
        await server.wait_closed()
    asyncio.run(scenario())


@pytest.mark.parametrize(("inputs", "address_map", "said"), [
    ({"a": "%IW0"}, AddressMap(field_window=False), r"%IW0 for writing .*window is closed"),
    ({"a": "%IB0"}, AddressMap(), "does not show %IB0"),
    ({"a": "%IW1020"}, AddressMap([MapRange(ObjectType.HOLDING, 0, 8, "IW", access="rw")]),
     "does not show %IW1020"),
])
def test_a_wired_address_that_the_map_does_not_show_is_refused_at_once(
        inputs: dict[str, str], address_map: AddressMap, said: str) -> None:
    with pytest.raises(UnmappedError, match=said):
        Bench(inputs, {}, address_map).link(502)
