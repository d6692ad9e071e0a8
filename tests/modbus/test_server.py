"""The server on real sockets of the loopback."""

from __future__ import annotations

import asyncio
import socket
import struct
from collections.abc import Callable
from typing import Any

import pytest

from plcemu.io.exchange import Exchange
from plcemu.modbus import AddressMap, Identity, ListenError, ModbusTcpServer

Serve = Callable[..., Any]
READ_COIL = bytes.fromhex("01 0000 0001")
COIL_IS_OFF = bytes.fromhex("01 01 00")


def test_pipelined_requests_are_answered_in_order(serve: Serve, raw_peer: Any,
                                                  framed: Callable[..., bytes]) -> None:
    async def scenario(server: ModbusTcpServer) -> list[tuple[int, int, bytes]]:
        peer = await raw_peer.connect(server)
        await peer.send(b"".join(framed(READ_COIL, t, t % 256) for t in range(500)))
        answers = [await peer.receive() for _ in range(500)]
        await peer.close()
        return answers
    assert serve(scenario) == [(t, t % 256, COIL_IS_OFF) for t in range(500)]


def test_a_request_in_single_bytes_is_answered(serve: Serve, raw_peer: Any,
                                               framed: Callable[..., bytes]) -> None:
    async def scenario(server: ModbusTcpServer) -> tuple[int, int, bytes]:
        peer = await raw_peer.connect(server)
        for byte in framed(READ_COIL, 9):
            await peer.send(bytes((byte,)))
        answer: tuple[int, int, bytes] = await peer.receive()
        await peer.close()
        return answer
    assert serve(scenario) == (9, 1, COIL_IS_OFF)


def test_requests_sent_before_the_peer_ends_its_half_are_all_answered(
        serve: Serve, framed: Callable[..., bytes]) -> None:
    async def scenario(server: ModbusTcpServer) -> int:
        reader, writer = await asyncio.open_connection(server.host, server.port)
        writer.write(b"".join(framed(READ_COIL, t) for t in range(200)))
        writer.write_eof()
        answers = await reader.read(-1)
        writer.close()
        await writer.wait_closed()
        return len(answers)
    assert serve(scenario) == 200 * (7 + len(COIL_IS_OFF))


def test_a_peer_that_reads_its_answers_late_gets_every_one_in_order(
        serve: Serve, raw_peer: Any, framed: Callable[..., bytes]) -> None:
    count, pdu = 30_000, bytes.fromhex("03 0000 007d")

    async def scenario(server: ModbusTcpServer) -> list[int]:
        peer = await raw_peer.connect(server)
        sending = asyncio.create_task(
            peer.send(b"".join(framed(pdu, t) for t in range(count))))
        answers = [(await peer.receive())[0] for _ in range(count)]
        await sending
        await peer.close()
        return answers
    assert serve(scenario) == list(range(count))


def test_a_clients_reads_see_its_waiting_writes_other_clients_see_them_after_the_scan(
        serve: Serve, raw_peer: Any, exchange: Exchange) -> None:
    read = bytes.fromhex("03 0000 0001")

    async def scenario(server: ModbusTcpServer) -> list[bytes]:
        writer, reader = await raw_peer.connect(server), await raw_peer.connect(server)
        await writer.ask(bytes.fromhex("06 0000 1234"))
        before = [await writer.ask(read), await reader.ask(read)]
        exchange.update_inputs()
        after = [await writer.ask(read), await reader.ask(read)]
        await writer.close()
        await reader.close()
        return before + after
    assert [r.hex() for r in serve(scenario)] == ["03021234", "03020000", "03021234", "03021234"]


@pytest.mark.parametrize("header", [
    struct.pack(">HHHB", 1, 1, 6, 1), struct.pack(">HHHB", 1, 0, 1, 1),
    struct.pack(">HHHB", 1, 0, 255, 1), b"GET / HTTP/1.1\r\n\r\n"])
def test_a_connection_that_lost_framing_is_closed_and_counted(serve: Serve, raw_peer: Any,
                                                              header: bytes) -> None:
    async def scenario(server: ModbusTcpServer) -> bytes:
        peer = await raw_peer.connect(server)
        await peer.send(header)
        received: bytes = await peer.read_to_end()
        await peer.close()
        assert server.counters["protocol_errors"] == 1
        assert server.counters["closed_for_protocol_error"] == 1
        return received
    assert serve(scenario) == b""


def test_units_outside_the_set_are_answered_as_missing_behind_a_gateway(
        serve: Serve, raw_peer: Any) -> None:
    async def scenario(server: ModbusTcpServer) -> list[bytes]:
        peer = await raw_peer.connect(server)
        answers = [await peer.ask(READ_COIL, unit=u) for u in (1, 2, 255, 0)]
        await peer.close()
        assert server.counters["unknown_units"] == 2
        assert (server.counters["requests"], server.counters["exceptions"]) == (4, 2)
        return answers
    refused = bytes.fromhex("81 0b")
    assert serve(scenario, units={1, 255}) == [COIL_IS_OFF, refused, COIL_IS_OFF, refused]


def test_units_outside_the_set_are_met_with_silence_if_so_set(
        serve: Serve, raw_peer: Any, framed: Callable[..., bytes]) -> None:
    async def scenario(server: ModbusTcpServer) -> tuple[int, int, bytes]:
        peer = await raw_peer.connect(server)
        await peer.send(framed(READ_COIL, 1, unit=2) + framed(READ_COIL, 2, unit=1))
        answer: tuple[int, int, bytes] = await peer.receive()
        await peer.close()
        return answer
    answer = serve(scenario, units={1}, is_silent_for_unknown_units=True)
    assert answer == (2, 1, COIL_IS_OFF)


@pytest.mark.parametrize("sent", [b"", b"\0", b"\0\1\0\0\0\6\1\3"])
def test_a_peer_without_a_complete_request_is_closed_after_the_idle_timeout(
        serve: Serve, raw_peer: Any, sent: bytes) -> None:
    async def scenario(server: ModbusTcpServer) -> int:
        peer = await raw_peer.connect(server)
        await peer.send(sent)
        assert await peer.read_to_end() == b""
        await peer.close()
        return server.counters["closed_for_idleness"]
    assert serve(scenario, idle_timeout_s=0.01) == 1


def test_without_an_idle_timeout_no_timer_runs(serve: Serve, raw_peer: Any) -> None:
    async def scenario(server: ModbusTcpServer) -> bytes:
        peer = await raw_peer.connect(server)
        answer: bytes = await peer.ask(READ_COIL)
        await peer.close()
        return answer
    assert serve(scenario, idle_timeout_s=None) == COIL_IS_OFF


def test_when_all_connections_are_in_use_the_newcomer_is_refused(
        serve: Serve, raw_peer: Any, caplog: pytest.LogCaptureFixture) -> None:
    async def scenario(server: ModbusTcpServer) -> None:
        first, second = await raw_peer.connect(server), await raw_peer.connect(server)
        await first.ask(READ_COIL)
        await second.ask(READ_COIL)
        newcomer = await raw_peer.connect(server)
        assert await newcomer.read_to_end() == b""
        assert await first.ask(READ_COIL) == await second.ask(READ_COIL) == COIL_IS_OFF
        assert server.counters["connections_refused"] == 1
        assert server.counters["connections_open"] == 2
        for peer in (first, second, newcomer):
            await peer.close()
    serve(scenario, max_connections=2)
    assert "modbus.max_connections (2) are in use" in caplog.text


def test_the_longest_silent_connection_gives_way_to_a_newcomer(
        serve: Serve, raw_peer: Any) -> None:
    async def scenario(server: ModbusTcpServer) -> None:
        first, second = await raw_peer.connect(server), await raw_peer.connect(server)
        await second.ask(READ_COIL)
        await first.ask(READ_COIL)
        newcomer = await raw_peer.connect(server)
        assert await newcomer.ask(READ_COIL) == COIL_IS_OFF
        assert await second.read_to_end() == b""
        assert await first.ask(READ_COIL) == COIL_IS_OFF
        assert server.counters["closed_for_newcomer"] == 1
        assert server.counters["connections_open"] == 2
        for peer in (first, second, newcomer):
            await peer.close()
    serve(scenario, max_connections=2, gives_way_after_s=0.0)


def test_counters_add_up_after_everyone_has_gone(serve: Serve, raw_peer: Any) -> None:
    async def scenario(server: ModbusTcpServer) -> dict[str, int]:
        leaving, staying = await raw_peer.connect(server), await raw_peer.connect(server)
        await leaving.ask(READ_COIL)
        await staying.ask(bytes.fromhex("01 0000 0000"))
        await leaving.close()
        await staying.ask(READ_COIL)
        await server.stop()
        assert await staying.read_to_end() == b""
        await staying.close()
        return server.counters
    assert serve(scenario) == {
        "requests": 3, "exceptions": 1, "unknown_units": 0, "protocol_errors": 0,
        "bytes_received": 36, "bytes_sent": 10 + 9 + 10,
        "connections_accepted": 2, "connections_open": 0, "connections_refused": 0,
        "closed_by_peer": 1, "closed_by_server": 1, "closed_for_idleness": 0,
        "closed_for_newcomer": 0, "closed_for_protocol_error": 0}


def test_a_stopped_server_can_start_again_at_the_same_port(
        serve: Serve, raw_peer: Any) -> None:
    async def scenario(server: ModbusTcpServer) -> bytes:
        port = server.port
        await server.stop()
        await server.stop()
        await server.start()
        assert server.port == port
        peer = await raw_peer.connect(server)
        answer: bytes = await peer.ask(READ_COIL)
        await peer.close()
        return answer
    assert serve(scenario) == COIL_IS_OFF


def test_a_port_in_use_is_told_with_what_to_do(serve: Serve, exchange: Exchange) -> None:
    async def scenario(server: ModbusTcpServer) -> str:
        second = ModbusTcpServer(exchange, AddressMap(), Identity(), port=server.port)
        with pytest.raises(ListenError) as caught:
            await second.start()
        return str(caught.value).replace(str(server.port), "5020")
    assert serve(scenario) == ("cannot listen on 127.0.0.1:5020: address already in use; "
                               "another plcemu runs, or choose modbus.port")


def test_a_host_that_does_not_exist_is_told(exchange: Exchange,
                                            monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(*_: object, **__: object) -> None:
        raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")
    monkeypatch.setattr(socket, "getaddrinfo", unknown)
    server = ModbusTcpServer(exchange, AddressMap(), Identity(), host="plc.invalid")
    with pytest.raises(ListenError, match=r"cannot listen on plc.invalid:5020: Name or service"):
        asyncio.run(server.start())


def test_two_servers_in_one_process_have_identities_of_their_own(
        serve: Serve, raw_peer: Any, exchange: Exchange) -> None:
    async def scenario(server: ModbusTcpServer) -> list[bytes]:
        other = ModbusTcpServer(exchange, AddressMap(), Identity(vendor="Other"), port=0)
        await other.start()
        peers = [await raw_peer.connect(s) for s in (server, other)]
        vendors = [(await p.ask(bytes.fromhex("2b 0e 04 00")))[9:] for p in peers]
        for peer in peers:
            await peer.close()
        await other.stop()
        return vendors
    assert serve(scenario) == [b"Example", b"Other"]


def test_a_peer_that_never_reads_its_answers_is_closed_after_the_idle_timeout(
        serve: Serve, raw_peer: Any, framed: Callable[..., bytes]) -> None:
    flood = framed(bytes.fromhex("03 0000 007d")) * 5000

    async def scenario(server: ModbusTcpServer) -> int:
        peer = await raw_peer.connect(server)
        with pytest.raises(ConnectionError):
            while True:
                await peer.send(flood)
        await peer.close()
        return server.counters["closed_for_idleness"]
    assert serve(scenario, idle_timeout_s=0.05) == 1


def test_stopping_ends_connections_whose_requests_still_wait(
        serve: Serve, raw_peer: Any, framed: Callable[..., bytes]) -> None:
    async def scenario(server: ModbusTcpServer) -> None:
        peer = await raw_peer.connect(server)
        await peer.send(framed(READ_COIL) * 100)
        await peer.receive()
        server.new_scan()
        await server.stop()
        await peer.close()
        assert server.counters["requests"] == 5
        assert server.counters["closed_by_server"] == 1
    serve(scenario, budget=5)


def test_a_connection_that_comes_while_the_server_stops_is_refused(
        serve: Serve, fake_connection: Any) -> None:
    async def scenario(server: ModbusTcpServer) -> None:
        await server.stop()
        late = fake_connection(server)
        assert late.transport.is_closing()
        late.lose()
        assert server.counters["connections_refused"] == 1
    serve(scenario)
