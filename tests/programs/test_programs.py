"""Whole programs of the size and style that users write, against oracles in Python."""

import binascii
import datetime
import math
import random
import statistics
from pathlib import Path

import pytest

import plcemu

HERE = Path(__file__).parent
MS = 1_000_000


def started(name):
    """A PLC with one of the programs, cycle 10 ms, before its first scan."""
    return plcemu.Plc(HERE / f"{name}.st", cycle="10ms")


def scanned(plc, scans=1, **inputs):
    """The PLC after the inputs are written and it has been scanned."""
    for name, value in inputs.items():
        plc[f"MAIN.{name}"] = value
    plc.scan(scans)
    assert plc.state == "RUN", plc.fault
    return plc


def elements(plc, name, count, first=0):
    return [plc[f"{name}[{n}]"] for n in range(first, first + count)]


@pytest.mark.parametrize("path", sorted(HERE.glob("*.st")), ids=lambda p: p.stem)
def test_every_program_compiles_and_runs_for_a_second(path):
    plc = plcemu.Plc(path, cycle="10ms")
    plc.run_for("1s")
    assert (plc.state, plc.fault) == ("RUN", "")


# ---------------------------------------------------------------- mathematics


@pytest.mark.parametrize("x", [-3.0, 0.0, 0.5, 2.0, 11.0])
def test_the_polynomial_is_horners(x):
    plc = scanned(started("mathematics"), x=x)
    assert plc["poly"] == pytest.approx(1 - 2 * x + 0.5 * x**2 + 0.25 * x**3 + 0.25 * x**4)


def test_matrices_are_multiplied_and_have_determinants():
    plc = scanned(started("mathematics"))
    m = [[2, 0, 1], [1, 3, 2], [1, 1, 4]]
    square = [sum(m[i][k] * m[k][j] for k in range(3)) for i in range(3) for j in range(3)]
    found = [plc[f"square[{i},{j}]"] for i in (1, 2, 3) for j in (1, 2, 3)]
    assert (found, plc["det"], plc["dot_"]) == (square, 18.0, 14.0)


def test_statistics_of_samples():
    samples = [4.0, 8.0, 15.0, 16.0, 23.0, 42.0]
    plc = scanned(started("mathematics"))
    assert plc["stats.mean"] == pytest.approx(statistics.mean(samples))
    assert plc["stats.deviation"] == pytest.approx(statistics.pstdev(samples))
    assert (plc["stats.smallest"], plc["stats.largest"]) == (4.0, 42.0)


@pytest.mark.parametrize(("x", "y"), [(-1, 0), (0, 0), (5, 2.5), (10, 5), (15, 15), (20, 25),
                                      (99, 25)])
def test_interpolation_in_a_table(x, y):
    assert scanned(started("mathematics"), where=x)["between"] == y


@pytest.mark.parametrize("n", [0, 1, 2, 3, 4, 25, 97, 7919, 7921])
def test_primes(n):
    prime = n > 1 and all(n % d for d in range(2, math.isqrt(n) + 1))
    assert scanned(started("mathematics"), n=n)["prime"] is prime


def test_whole_numbers_and_roots():
    plc = scanned(started("mathematics"))
    assert (plc["common"], plc["fact"]) == (12, math.factorial(20))
    assert plc["root"] == pytest.approx(3.0)


@pytest.mark.parametrize(("y", "x"), [(1, 1), (1, -1), (-1, -1), (-1, 1), (1, 0), (-1, 0), (0, -1)])
def test_the_angle_of_a_point(y, x):
    plc = scanned(started("mathematics"), y=float(y), x=float(-x))
    assert plc["angle"] == pytest.approx(math.degrees(math.atan2(y, x)))


# ---------------------------------------------------------------- calendar


def easter(year):
    """The anonymous algorithm in Butcher's form, by golden number and epact."""
    golden, century = year % 19 + 1, year // 100 + 1
    x, z = 3 * century // 4 - 12, (8 * century + 5) // 25 - 5
    d = 5 * year // 4 - x - 10
    e = (11 * golden + 20 + z - x) % 30
    e += (e == 25 and golden > 11) or e == 24
    n = 44 - e + (30 if 44 - e < 21 else 0)
    n += 7 - (d + n) % 7
    return (4, n - 31) if n > 31 else (3, n)


@pytest.mark.parametrize("year", [1970, 1999, 2000, 2008, 2024, 2025, 2038, 2100, 2285])
def test_easter_and_the_days_of_a_year(year):
    plc = started("calendar")
    for month, day in ((1, 1), (2, 28), (12, 31)):
        date = datetime.date(year, month, day)
        scanned(plc, year=year, month=date.month, day=date.day)
        assert plc["nth"] == date.timetuple().tm_yday
        assert plc["number"] == (date - datetime.date(1970, 1, 1)).days
        assert plc["weekday_"] == date.weekday()
        assert plc["weekend"] is (date.weekday() >= 5)
    assert (plc["sunday.month"], plc["sunday.day"]) == easter(year)
    assert plc["leap"] is (datetime.date(year, 12, 31).timetuple().tm_yday == 366)


def test_days_are_long_in_june_and_short_in_december():
    plc = started("calendar")
    june = scanned(plc, year=2023, month=6, day=21)["light"]
    december = scanned(plc, month=12, day=21)["light"]
    assert (june, december) == (pytest.approx(15.8, abs=0.2), pytest.approx(8.2, abs=0.2))


# ---------------------------------------------------------------- control


def test_the_filter_follows_a_step_by_its_time_constant():
    plc = scanned(started("control"), x=0.0)
    y = 0.0
    for _ in range(20):
        y += (10.0 - y) * 0.1
        assert scanned(plc, x=10.0)["low_pass.y"] == pytest.approx(y, rel=1e-5)


def test_the_ramp_rises_slower_than_it_falls():
    plc = started("control")
    assert [scanned(plc, x=3.0)["ramp.y"] for _ in range(4)] == [1, 2, 3, 3]
    assert [scanned(plc, x=0.0)["ramp.y"] for _ in range(3)] == [1, 0, 0]
    assert plc["ramp.there"] is True


def test_the_two_point_controller_has_a_hysteresis():
    plc = started("control")
    found = [scanned(plc, x=float(x))["level.q"] for x in (5, 2, 5, 7, 8, 5, 3, 1)]
    assert found == [False, True, True, True, False, False, False, True]


def test_the_controller_drives_a_process_to_its_setpoint():
    plc = scanned(started("control"), auto=True, sp=50.0)
    level = 0.0
    for _ in range(400):
        level += 0.05 * (scanned(plc, pv=level)["pid.out"] - level)
    assert level == pytest.approx(50.0, abs=0.1)
    assert scanned(plc, auto=False)["pid.out"] == 12.5


def test_the_motor_starts_runs_stops_and_trips():
    plc = started("control")
    stopped, starting, running, stopping, tripped = range(5)
    assert scanned(plc)["pump.state"] == stopped
    assert scanned(plc, start=True)["pump.state"] == starting
    assert scanned(plc, feedback=True)["pump.state"] == running
    assert scanned(plc, stop=True)["pump.state"] == stopping
    assert scanned(plc, feedback=False, start=False)["pump.state"] == stopped
    assert scanned(plc, stop=False, start=True)["pump.contactor"] is True
    assert scanned(plc, 8)["pump.state"] == tripped
    assert scanned(plc, reset=True, overload=True)["pump.state"] == tripped
    assert scanned(plc, overload=False)["pump.state"] == stopped
    assert plc["pump.starts"] == 2


def test_the_valve_reports_a_travel_that_takes_too_long():
    plc = scanned(started("control"), closed=True)
    scanned(plc, 30, command=True)
    assert (plc["inlet.moving"], plc["inlet.fault"]) == (True, False)
    assert scanned(plc, 2)["inlet.fault"] is True
    assert scanned(plc, opened=True, closed=False)["inlet.fault"] is False


def test_alarms_sound_until_they_are_acknowledged():
    plc = scanned(started("control"))
    plc["MAIN.condition[2]"] = True
    scanned(plc, 3)
    assert (plc["bank.horn"], plc["bank.pending"], plc["book[2].since"]) == (True, 1, 30 * MS)
    scanned(plc, acknowledge=True)
    assert (plc["bank.horn"], plc["bank.pending"], plc["book[2].count"]) == (False, 0, 1)


def test_the_sequencer_goes_round_its_patterns():
    plc = scanned(started("control"), run=True)
    found = [plc["steps.outputs"]]
    for _ in range(4):
        found.append(scanned(plc, step_done=True)["steps.outputs"])
        scanned(plc, step_done=False)
    assert found == [0x01, 0x06, 0xF0, 0xFF, 0x01]
    assert plc["steps.finished"] is True


# ---------------------------------------------------------------- buffers


def test_the_buffer_gives_back_first_what_came_first():
    plc, model, random_ = started("buffers"), [], random.Random(7)
    for n in range(200):
        put, take = random_.random() < 0.6, random_.random() < 0.5
        scanned(plc, do_put=put, do_take=take, put_value=n)
        expected = plc["taken"]
        if put and len(model) < 8:
            model.append(n)
        if take and model:
            expected = model.pop(0)
        assert (plc["taken"], plc["fifo.count"]) == (expected, len(model))


def test_numbers_are_sorted_and_found():
    plc = scanned(started("buffers"))
    numbers = [5, 3, 9, -1, 0, 8, 2, 7, 7, -30]
    assert elements(plc, "numbers", 10) == sorted(numbers)
    assert sorted(numbers)[plc["found"]] == 7
    assert plc["swaps"] == sum(a > b for i, a in enumerate(numbers) for b in numbers[i + 1:])


def crc16(data):
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return crc


def test_checksums():
    plc = scanned(started("buffers"))
    data = b"123456789"
    assert (plc["crc_16"], plc["crc_32"]) == (crc16(data), binascii.crc32(data))


def test_the_moving_average_has_a_window_of_four():
    plc, seen = started("buffers"), []
    for sample in (4, 8, -3, 100, 0, 7, 7):
        seen.append(sample)
        assert scanned(plc, sample=sample)["mean"] == pytest.approx(statistics.mean(seen[-4:]))


@pytest.mark.parametrize(("telegram", "good"), [
    (b"\x02A\x03abc" + bytes([ord("A") ^ 3 ^ ord("a") ^ ord("b") ^ ord("c")]), True),
    (b"\x02A\x03abc\x00", False)])
def test_the_telegram_is_parsed_octet_by_octet(telegram, good):
    plc = started("buffers")
    for octet in b"\x99" + telegram:
        scanned(plc, octet=octet, valid=True)
    assert (plc["parse.complete"], plc["received.good"]) == (True, good)
    assert bytes(elements(plc, "received.bytes", 3)) == b"abc"
    assert scanned(plc, valid=False)["parse.complete"] is False


# ---------------------------------------------------------------- strings


def test_strings_are_trimmed_turned_and_split():
    plc = scanned(started("strings"))
    text = "one,two,,'four'"
    assert (plc["trimmed"], plc["capitals"], plc["backwards"], plc["replaced"]) == (
        text, text.upper(), text[::-1], text.replace(",", "; "))
    assert plc["words_.count"] == 4
    assert elements(plc, "words_.item", 4, 1) == text.split(",")


def test_strings_and_numbers_become_each_other():
    plc = scanned(started("strings"), 12)
    assert (plc["number"], plc["code"], plc["message"]) == (-1204, "00C0FFEE", "scan 12 of -1204x")
    assert (plc["inserted"], plc["before"]) == ("a--b", True)


# ---------------------------------------------------------------- Annex F


@pytest.mark.parametrize(("gross", "net"), [(0x1234, 0x1200), (0x0034, 0), (0x9999, 0x9965)])
def test_weigh_subtracts_the_tare_in_bcd(gross, net):
    assert scanned(started("annex_f"), weigh_command=True, gross=gross)["net"] == net


def test_a_command_without_feedback_alarms_until_it_is_acknowledged():
    plc = scanned(started("annex_f"), man_fwd=True)
    assert (plc["motors.kl_fwd"], plc["motors.alarm"]) == (True, False)
    assert scanned(plc, 4)["motors.alarm"] is True
    assert scanned(plc, fwd_fdbk=True)["motors.alarm"] is True
    assert scanned(plc, ack=True)["motors.alarm"] is False
    scanned(plc, ack=False, man_rev=True)
    assert (plc["motors.kl_fwd"], plc["motors.kl_rev"], plc["motors.alarm"]) == (False, False, True)


def test_the_stack_of_integers():
    plc = scanned(started("annex_f"), r1=True)
    assert plc["stack.empty"] is True
    scanned(plc, r1=False)
    for value in (11, 22):
        scanned(plc, **{"push": True, "in": value})
        scanned(plc, 2, push=False)
        assert (plc["stack.out"], plc["stack.oflo"]) == (value, False)
    assert scanned(plc, push=True)["stack.oflo"] is True
    scanned(plc, push=False)
    assert [scanned(plc, pop=p)["stack.ptr"] for p in (True, True, False, True)] == [1, 1, 1, 0]
    assert (plc["stack.out"], plc["stack.empty"]) == (11, False)
    scanned(plc, pop=False)
    assert scanned(plc, pop=True)["stack.empty"] is True


def test_two_substances_and_bricks_are_mixed():
    plc = scanned(started("annex_f"), s0=True)
    scanned(plc, 2, st=True)
    assert (plc["mixer.va"], plc["mixer.mt"]) == (True, True)
    for _ in range(2):
        scanned(plc, 2, st=False, d=1.0)
        scanned(plc, 2, d=0.0)
    assert plc["mixer.LOADED.X"] is True
    assert scanned(plc, 1, wc=20.0)["mixer.vb"] is True
    assert scanned(plc, 1, wc=30.0)["mixer.vc"] is True
    assert scanned(plc, 1, wc=0.0)["mixer.mr"] is True
    assert scanned(plc, 4)["mixer.MIX.X"] is True
    assert scanned(plc, 2, s0=False)["mixer.mp1"] is True
    assert scanned(plc, 1, s1=True)["mixer.mp0"] is True
    assert (plc["mixer.mr"], scanned(plc, s0=True, s1=False)["mixer.START.X"]) == (False, True)


def test_signals_are_lagged_delayed_and_averaged():
    plc = scanned(started("annex_f"))
    signal = [float(n * n % 7) for n in range(20)]
    lag, held = 0.0, [0.0] * 4
    for x in signal:
        scanned(plc, run=True, x=x)
        lag += 0.1 * (x - lag)
        assert plc["lag.xout"] == pytest.approx(lag, rel=1e-4)
        assert plc["dead.xout"] == held[-3]
        held.append(x)


def test_signals_are_integrated_and_differentiated():
    plc = scanned(started("annex_f"), x=0.0)
    for n in range(1, 11):
        scanned(plc, run=True, x=n * 0.5)
    assert plc["sum.xout"] == pytest.approx(sum(n * 0.005 for n in range(1, 11)), rel=1e-5)
    assert plc["slope.xout"] == pytest.approx(50.0, rel=1e-4)


def test_hysteresis_ramp_and_hand_transfer():
    plc = started("annex_f")
    found = [scanned(plc, x=float(x))["hys.q"] for x in (5, 6, 7, 5, 4, 3)]
    assert found == [False, False, True, True, True, False]
    found = [scanned(plc, run=True)["rise.xout"] for _ in range(7)]
    assert found == pytest.approx([0, 2, 4, 6, 8, 10, 10])
    assert [scanned(plc, slow_up=True)["hand.xout"] for _ in range(3)] == [0.5, 1.0, 1.5]


def test_the_loop_of_annex_f_is_proportional_and_integral():
    plc = scanned(started("annex_f"), x=1.0)
    scanned(plc, 1, run=True, x=2.0)
    assert plc["loop.xout"] == pytest.approx(2.0 * (1.0 + plc["iterm.xout"] / 0.5), rel=1e-5)


def test_gravel_is_filled_loaded_and_watched():
    plc = started("gravel")

    def scan(n=1, **inputs):
        for name, value in inputs.items():
            plc[f"quarry.{name}"] = value
        plc.scan(n)
        return plc

    scan()
    scan(on_pb=True)
    assert (plc["control_lamp"], plc["truck_lamp"]) == (True, True)
    scan(on_pb=False, fill_pb=True)
    assert (plc["silo_valve"], plc["conveyor"]) == (True, False)
    scan(3)
    assert plc["conveyor"] is True
    scan(bin_full=True, fill_pb=False)
    assert (plc["silo_valve"], plc["conveyor"]) == (False, False)
    scan(load_pb=True, truck_on_ramp=True)
    assert (plc["gate"], plc["loads"], plc["truck_lamp"]) == (True, 1, False)
    scan(11, load_pb=False)
    assert (plc["gate"], plc["truck_lamp"]) == (False, True)
    scan(silo_empty=True)
    assert plc["siren"] is True
    scan(siren_ack=True)
    assert plc["siren"] is False
    scan(off_pb=True)
    assert plc["OFF_CTL.X"] is True
