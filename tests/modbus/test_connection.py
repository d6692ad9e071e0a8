"""How a connection shares the event loop with the scan cycle: turns, budget, back-pressure.

Connections here are driven by hand over a fake transport; `asyncio.sleep(0)` is one turn of the
loop.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from plcemu.modbus import ModbusTcpServer
from plcemu.modbus.server import LEAST_REQUESTS

Serve = Callable[..., Any]


async def turns(count: int) -> None:
    for _ in range(count):
        await asyncio.sleep(0)


def test_a_turn_answers_so_many_requests_and_reads_nothing_while_more_wait(
        serve: Serve, fake_connection: Any) -> None:
    async def scenario(server: ModbusTcpServer) -> list[tuple[int, bool]]:
        peer, seen = fake_connection(server), []
        peer.receive_requests(*range(10))
        for _ in range(4):
            seen.append((len(peer.transport.transactions), peer.transport.is_paused))
            await turns(1)
        assert peer.transport.transactions == list(range(10))
        peer.lose()
        return seen
    assert serve(scenario, requests_per_turn=4) == [(4, True), (8, True), (10, False), (10, False)]


def test_a_flood_in_one_piece_leaves_the_loop_a_turn_for_every_32_requests(
        serve: Serve, fake_connection: Any) -> None:
    async def scenario(server: ModbusTcpServer) -> int:
        peer, count = fake_connection(server), 0
        peer.receive_requests(*range(20_000))
        while peer.transport.is_paused:
            await turns(1)
            count += 1
        assert peer.transport.transactions == list(range(20_000))
        peer.lose()
        return count
    assert serve(scenario) >= 20_000 // 32 - 1


def test_a_turn_of_the_loop_works_at_the_backlog_of_one_connection_only(
        serve: Serve, fake_connection: Any) -> None:
    async def scenario(server: ModbusTcpServer) -> list[int]:
        peers = [fake_connection(server) for _ in range(3)]
        for peer in peers:
            peer.receive_requests(*range(20))
        served = []
        for _ in range(9):
            served.append(server.counters["requests"])
            await turns(1)
        assert [p.transport.transactions for p in peers] == [list(range(20))] * 3
        for peer in peers:
            peer.lose()
        return served
    assert serve(scenario, requests_per_turn=5) == [15, 20, 25, 30, 35, 40, 45, 50, 55]


def test_when_the_budget_is_used_up_requests_wait_for_the_next_scan(
        serve: Serve, fake_connection: Any) -> None:
    async def scenario(server: ModbusTcpServer) -> list[int]:
        peer, answered = fake_connection(server), []
        peer.receive_requests(*range(8))
        for _ in range(4):
            await turns(5)
            answered.append(len(peer.transport.transactions))
            server.new_scan()
        assert not peer.transport.is_paused
        peer.lose()
        return answered
    assert serve(scenario, budget=3) == [3, 6, 8, 8]


def test_connections_that_wait_for_the_budget_take_their_turns_in_order(
        serve: Serve, fake_connection: Any) -> None:
    async def scenario(server: ModbusTcpServer) -> list[list[int]]:
        peers, answered = [fake_connection(server) for _ in range(3)], []
        for peer in peers:
            peer.receive_requests(*range(4))
        for _ in range(5):
            answered.append([len(p.transport.transactions) for p in peers])
            server.new_scan()
            await turns(5)
        for peer in peers:
            peer.lose()
        return answered
    assert serve(scenario, budget=2) == [[2, 0, 0], [4, 0, 0], [4, 2, 0], [4, 2, 2], [4, 4, 2]]


def test_without_a_budget_from_the_next_scan_on_everything_that_waits_is_served(
        serve: Serve, fake_connection: Any) -> None:
    async def scenario(server: ModbusTcpServer) -> list[int]:
        peer = fake_connection(server)
        peer.receive_requests(*range(5))
        server.budget = None
        server.new_scan()
        await turns(1)
        peer.lose()
        return list(peer.transport.transactions)
    assert serve(scenario, budget=1) == [0, 1, 2, 3, 4]


def test_a_connection_lost_while_it_waits_is_forgotten(serve: Serve, fake_connection: Any) -> None:
    async def scenario(server: ModbusTcpServer) -> int:
        peer = fake_connection(server)
        peer.receive_requests(*range(5))
        peer.transport.close()
        peer.lose()
        server.new_scan()
        await turns(2)
        return len(peer.transport.transactions)
    assert serve(scenario, budget=1) == 1


def test_a_peer_that_takes_no_answers_is_answered_no_more_until_it_does(
        serve: Serve, fake_connection: Any) -> None:
    async def scenario(server: ModbusTcpServer) -> None:
        peer = fake_connection(server)
        peer.protocol.pause_writing()
        peer.receive_requests(1, 2)
        await turns(3)
        assert (peer.transport.transactions, peer.transport.is_paused) == ([], True)
        peer.protocol.resume_writing()
        await turns(1)
        assert (peer.transport.transactions, peer.transport.is_paused) == ([1, 2], False)
        peer.lose()
    serve(scenario)


def test_requests_before_a_lost_framing_are_answered_those_after_it_are_not(
        serve: Serve, fake_connection: Any, framed: Callable[..., bytes]) -> None:
    async def scenario(server: ModbusTcpServer) -> None:
        peer = fake_connection(server)
        request = framed(bytes.fromhex("01 0000 0001"), 7)
        peer.protocol.data_received(request + b"\0\0\xff\xff\0\6" + request)
        peer.protocol.data_received(request)
        assert (peer.transport.transactions, peer.transport.is_closing()) == ([7], True)
        peer.lose()
        assert server.counters["protocol_errors"] == 1
        assert server.counters["closed_for_protocol_error"] == 1
    serve(scenario)


def test_garbage_of_many_connections_gives_one_line_in_the_log(
        serve: Serve, fake_connection: Any, caplog: pytest.LogCaptureFixture) -> None:
    async def scenario(server: ModbusTcpServer) -> int:
        for _ in range(50):
            peer = fake_connection(server)
            peer.protocol.data_received(b"GET / HTTP/1.1\r\n\r\n")
            peer.lose()
        return server.counters["protocol_errors"]
    assert serve(scenario) == 50
    assert [r.message for r in caplog.records if r.levelname == "WARNING"] == [
        "closed 192.0.2.1:40000: protocol identifier 21536, not 0 (Modbus)"]


def test_a_connection_that_waits_for_the_budget_is_not_idle(
        serve: Serve, fake_connection: Any) -> None:
    async def scenario(server: ModbusTcpServer) -> None:
        waiting, idle = fake_connection(server), fake_connection(server)
        waiting.receive_requests(1, 2)
        closing = asyncio.Event()
        idle.transport.abort = closing.set
        await closing.wait()
        await turns(1)
        assert not waiting.transport.is_closing()
        waiting.lose()
        idle.lose()
    serve(scenario, budget=1, idle_timeout_s=0.01)


class HandClock:
    """A clock that a test sets, or that moves by itself with every look."""

    def __init__(self, step_s: float = 0.0) -> None:
        self.now_s, self._step_s = 0.0, step_s

    def __call__(self) -> float:
        self.now_s += self._step_s
        return self.now_s


def test_near_the_next_release_requests_wait_for_the_scan_and_then_go_on(
        serve: Serve, fake_connection: Any) -> None:
    clock = HandClock()

    async def scenario(server: ModbusTcpServer) -> list[int]:
        peer, answered = fake_connection(server), []
        server.new_scan(until_s=1.0)
        peer.receive_requests(*range(60))
        answered.append(len(peer.transport.transactions))
        clock.now_s = 1.0
        await turns(5)
        answered.append(len(peer.transport.transactions))
        server.new_scan(until_s=2.0)
        await turns(5)
        answered.append(len(peer.transport.transactions))
        peer.lose()
        return answered
    assert serve(scenario, clock=clock, requests_per_turn=16) == [16, 16, 60]


@pytest.mark.parametrize("peers_count", [1, 64])
def test_floods_are_served_for_the_time_between_two_scans_and_no_longer(
        serve: Serve, fake_connection: Any, peers_count: int) -> None:
    cost_s, until_s = 0.001, 0.1  # every look at the clock takes 1 ms, and each request looks

    async def scenario(server: ModbusTcpServer) -> tuple[bool, float, int]:
        peers = [fake_connection(server) for _ in range(peers_count)]
        server.new_scan(until_s=until_s)
        for peer in peers:
            peer.receive_requests(*range(3000))
        await turns(50)
        served, overtime_s = server.counters["requests"], clock.now_s - until_s
        for peer in peers:
            peer.lose()
        return all(p.transport.is_paused for p in peers), overtime_s, served
    clock = HandClock(cost_s)
    paused, overtime_s, served = serve(scenario, clock=clock)
    looks_after_the_end = 2 * peers_count + 50
    assert paused
    assert 0 < overtime_s <= looks_after_the_end * cost_s
    assert 50 <= served <= until_s / cost_s


def test_a_plc_without_time_to_spare_still_serves_a_few_requests_a_scan(
        serve: Serve, fake_connection: Any) -> None:
    async def scenario(server: ModbusTcpServer) -> list[int]:
        server.new_scan(until_s=0.0)
        peer, answered = fake_connection(server), []
        peer.receive_requests(*range(20))
        for _ in range(3):
            await turns(3)
            answered.append(len(peer.transport.transactions))
            server.new_scan(until_s=0.0)
        peer.lose()
        return answered
    assert serve(scenario, clock=HandClock(), requests_per_turn=32) == [
        LEAST_REQUESTS, 2 * LEAST_REQUESTS, 20]


def test_while_nothing_may_be_served_the_loop_is_not_kept_busy(
        serve: Serve, fake_connection: Any) -> None:
    async def scenario(server: ModbusTcpServer) -> int:
        server.new_scan(until_s=0.0)
        peer = fake_connection(server)
        peer.receive_requests(*range(20))
        await turns(2)
        before = clock.looks
        await turns(100)
        peer.lose()
        return clock.looks - before

    class Counting(HandClock):
        looks = 0

        def __call__(self) -> float:
            self.looks += 1
            return super().__call__()
    clock = Counting()
    assert serve(scenario, clock=clock) == 0
