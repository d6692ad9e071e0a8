"""Conversions between every pair of types, against Python's own (IEC 61131-3, table 22)."""

import datetime
import math
import struct
from fractions import Fraction

import pytest
from controller import Controller, evaluate, findings, main
from hypothesis import given, settings
from hypothesis import strategies as st

from plcemu.base.errors import CompileError

WHOLE = {"SINT": (8, True), "INT": (16, True), "DINT": (32, True), "LINT": (64, True),
         "USINT": (8, False), "UINT": (16, False), "UDINT": (32, False), "ULINT": (64, False),
         "BYTE": (8, False), "WORD": (16, False), "DWORD": (32, False), "LWORD": (64, False)}
FLOATS = ("REAL", "LREAL")
NUMBERS = ("BOOL", *WHOLE, *FLOATS)
DAY = 86_400 * 10**9
UNITS = {"TIME": 10**6, "LTIME": 1, "TOD": 10**6, "DT": 10**9, "DATE": 10**9}


def limits(of):
    bits, signed = WHOLE[of]
    return (-(1 << bits - 1), (1 << bits - 1) - 1) if signed else (0, (1 << bits) - 1)


def wrapped(value, of):
    low, high = limits(of)
    return (value - low) % (high - low + 1) + low


def single(value):
    if math.isfinite(value) and abs(value) >= float(2**128 - 2**103):
        return math.copysign(math.inf, value)
    return struct.unpack("<f", struct.pack("<f", value))[0]


def as_number(value, of):
    """Return a number as another type, rounded half to even and wrapped."""
    if of == "BOOL":
        return value != 0
    if of == "REAL":
        return single(value) if isinstance(value, float) else nearest_single(int(value))
    if of == "LREAL":
        return float(value)
    return wrapped(round(Fraction(value)), of)


def nearest_single(value):
    """Return the nearest REAL of an integer, without rounding twice."""
    below = single(float(value))
    around = [below, *(struct.unpack("<f", struct.pack("<i", n))[0] for n in neighbours(below))]
    return min(around, key=lambda f: (abs(Fraction(f) - value), struct.pack("<f", f)[0] & 1))


def neighbours(value):
    (bits,) = struct.unpack("<i", struct.pack("<f", value))
    return [bits - 1, bits + 1] if value else []


def values(of):
    if of == "BOOL":
        return [False, True]
    if of == "REAL":
        return [0.0, 0.5, 1.5, 2.5, -0.5, -2.5, 100.25, -32768.5, 65535.0, 16777216.0, -1e9]
    if of == "LREAL":
        return [0.0, 0.5, -1.5, 2.5, 1e-9, 4294967296.5, -2147483649.0, 1e18, -9e18, 0.1]
    low, high = limits(of)
    return sorted({low, low + 1, 0, 1, 100, high - 1, high, high // 2 + 1, high // 3})


def converter(source, targets, suffix=""):
    """Return a controller that converts x to every other type."""
    declared = "".join(f"r{t} : {t}; t{t} : {t};" for t in targets)
    body = "\n".join(f"r{t} := {source}_TO_{t}(x); t{t} := TO_{t}(x);" for t in targets)
    return Controller(main(f"x : {source}; {declared}", body))


@pytest.mark.parametrize("source", NUMBERS)
def test_every_number_becomes_every_other_number(source):
    targets = [t for t in NUMBERS if t != source]
    plc = converter(source, targets)
    for value in values(source):
        plc["x"] = value
        plc.scan()
        expected = {t: as_number(value, t) for t in targets}
        assert {t: plc["r" + t] for t in targets} == expected, value
        assert {t: plc["t" + t] for t in targets} == expected, value


@given(st.floats(-2.0**90, 2.0**90, width=32))
@settings(max_examples=100, deadline=None)
def test_a_real_is_rounded_half_to_even_and_wrapped(value):
    REAL_SOURCE["x"] = value
    REAL_SOURCE.scan()
    assert {t: REAL_SOURCE["r" + t] for t in WHOLE} == {t: as_number(value, t) for t in WHOLE}


REAL_SOURCE = converter("REAL", list(WHOLE))


@pytest.mark.parametrize("of", WHOLE)
def test_a_real_that_is_no_number_has_no_integer_value(of):
    plc = Controller(main(f"x : REAL; r : {of};", f"r := REAL_TO_{of}(x / x);")).scan()
    assert "nan has no integer value" in str(plc.resource.fault)


# ---------------------------------------------------------------- times and dates


@pytest.mark.parametrize("source", NUMBERS)
def test_every_number_becomes_a_time_or_date_in_its_unit(source):
    plc = converter(source, list(UNITS))
    for value in [v for v in values(source) if abs(v) < 9_000_000_000]:
        plc["x"] = value
        plc.scan()
        ns = {t: (round(float(value) * unit) if isinstance(value, float) else value * unit)
              for t, unit in UNITS.items()}
        ns["TOD"] %= DAY
        ns["DATE"] -= ns["DATE"] % DAY
        assert {t: plc["r" + t] for t in UNITS} == ns, value


@pytest.mark.parametrize("source", UNITS)
def test_every_time_or_date_becomes_every_number_in_its_unit(source):
    plc = converter(source, list(NUMBERS))
    for value in (0, 1, 10**6, 1_500_000, 5 * 10**9, 70_000 * 10**6, DAY - 1, 20_000 * DAY,
                  -1_500_000_000):
        plc["x"] = value
        plc.scan()
        unit = UNITS[source]
        count = abs(value) // unit * (1 if value >= 0 else -1)
        expected = {t: wrapped(count, t) for t in WHOLE} | {
            "BOOL": value != 0, "REAL": single(value / unit), "LREAL": value / unit}
        assert {t: plc["r" + t] for t in NUMBERS} == expected, value


PAIRS = {("DT", "DATE"): lambda ns: ns - ns % DAY, ("DT", "TOD"): lambda ns: ns % DAY,
         ("DATE", "DT"): lambda ns: ns, ("TOD", "TIME"): lambda ns: ns,
         ("TIME", "TOD"): lambda ns: ns % DAY, ("TIME", "LTIME"): lambda ns: ns,
         ("LTIME", "TIME"): lambda ns: ns, ("LDT", "DT"): lambda ns: ns,
         ("DATE_AND_TIME", "TIME_OF_DAY"): lambda ns: ns % DAY,
         ("DATE_AND_TIME", "DATE"): lambda ns: ns - ns % DAY, ("LDT", "LTOD"): lambda ns: ns % DAY}


@pytest.mark.parametrize("pair", PAIRS)
def test_times_and_dates_become_each_other(pair):
    source, target = pair
    plc = Controller(main(f"x : {source}; r : {target};", f"r := {source}_TO_{target}(x);"))
    for value in (0, 1, 5 * 10**9, DAY - 1, DAY, 20_000 * DAY + 7, -1, -DAY, -DAY - 1):
        plc["x"] = value
        assert plc.scan()["r"] == PAIRS[pair](value), value


@pytest.mark.parametrize("name", ["TOD_TO_DATE", "DATE_TO_TOD", "TIME_TO_DATE", "INT_TO_COLOR",
                                  "BOOL_TRUNC_INT", "REAL_TRUNC_BOOL", "UINT_TO_BCD_INT",
                                  "INT_BCD_TO_UINT", "X_TO_INT", "TO_COLOR", "_TO_", "TO_"])
def test_what_is_no_conversion_of_the_standard_is_no_function(name):
    assert findings(main("r : BOOL;", f"r := {name}(r);")) == ["5:6: P0020"]


@pytest.mark.parametrize("body", ["r := INT_TO_REAL(1.5);", "r := REAL_TO_INT('a');",
                                  "r := BOOL_TO_INT(T#1s);", "r := TIME_TO_INT(5);",
                                  "r := STRING_TO_INT(\"a\");", "r := WORD_BCD_TO_INT(x);"])
def test_a_value_of_another_type_is_reported(body):
    assert [f[-5:] for f in findings(main("r : REAL; x : INT;", body))] == ["P0023"]


# ---------------------------------------------------------------- strings

WRITTEN = [
    ("BOOL", True, "TRUE"), ("BOOL", False, "FALSE"), ("SINT", -128, "-128"),
    ("INT", -32768, "-32768"), ("DINT", 5, "5"), ("LINT", -(1 << 63), "-9223372036854775808"),
    ("USINT", 255, "255"), ("UINT", 65535, "65535"), ("UDINT", 1 << 31, "2147483648"),
    ("ULINT", (1 << 64) - 1, "18446744073709551615"), ("BYTE", 255, "255"), ("WORD", 16, "16"),
    ("DWORD", 0, "0"), ("LWORD", 1 << 63, "9223372036854775808"), ("REAL", 1.5, "1.5"),
    ("REAL", 3.0, "3.0"), ("LREAL", -0.1, "-0.1"), ("LREAL", 1e100, "1e+100"),
    ("TIME", 5_400_005_000_000, "T#1h30m5ms"), ("TIME", 0, "T#0s"), ("TIME", -1, "T#-1ns"),
    ("LTIME", 86_400_000_000_001, "LTIME#1d1ns"), ("DATE", 0, "D#1970-01-01"),
    ("TOD", 56_215_360_000_000, "TOD#15:36:55.36"), ("DT", 0, "DT#1970-01-01-00:00:00"),
    ("DT", DAY - 1, "DT#1970-01-01-23:59:59.999999999"),
]


@pytest.mark.parametrize("kind", ["STRING", "WSTRING"])
@pytest.mark.parametrize(("of", "value", "text"), WRITTEN)
def test_a_value_is_written_to_a_string_and_read_back(of, value, text, kind):
    plc = Controller(main(f"x : {of}; y : {of}; s : {kind};",
                          f"s := {of}_TO_{kind}(x); y := {kind}_TO_{of}(s);"))
    plc["x"] = value
    plc.scan()
    assert (plc["s"], plc["y"]) == (text, value)


@pytest.mark.parametrize(("of", "text", "value"), [
    ("INT", " 12 ", 12), ("INT", "+5", 5), ("INT", "16#7F", 127), ("INT", "1_000", 1000),
    ("REAL", "1", 1.0), ("REAL", "-.5e1", -5.0), ("BOOL", "1", True), ("BOOL", "false", False),
    ("TIME", "1s", 10**9), ("TIME", "t#1h", 3600 * 10**9), ("DATE", "2024-02-29", 19782 * DAY),
    ("TOD", "1:02:03", 3723 * 10**9), ("DT", "date_and_time#1970-01-02-00:00:00", DAY),
])
def test_strings_are_read_as_literals_are_written(of, text, value):
    assert evaluate(f"r : {of};", f"r := STRING_TO_{of}('{text}');", "r") == value


@pytest.mark.parametrize(("of", "text", "reason"), [
    ("INT", "x", "'x' is no whole number"), ("INT", "", "no whole number"),
    ("INT", "--5", "no whole number"), ("INT", "1.5", "no whole number"),
    ("INT", "40000", "40000 is outside the range"), ("USINT", "-1", "-1 is outside the range"),
    ("ULINT", "18446744073709551616", "outside the range"), ("REAL", "1,5", "is no number"),
    ("BOOL", "yes", "neither TRUE nor FALSE"), ("TIME", "5", "is no TIME"),
    ("DATE", "2024-02-30", "is no DATE"), ("TOD", "D#2024-02-28", "is no TIME_OF_DAY"),
    ("DT", "2024-02-28", "is no DATE_AND_TIME"), ("INT", "9" * 200, "outside the range"),
])
def test_a_string_that_is_no_value_is_a_fault_with_its_reason(of, text, reason):
    plc = Controller(main(f"r : {of};", f"r := STRING_TO_{of}('{text}');")).scan()
    assert reason in str(plc.resource.fault)


@given(st.text(st.characters(max_codepoint=255), max_size=20))
@settings(max_examples=50, deadline=None)
def test_a_string_becomes_a_wstring_and_comes_back(text):
    RECODED["s"] = text
    RECODED.scan()
    assert (RECODED["w"], RECODED["r"]) == (text, text)


RECODED = Controller(main("s : STRING; w : WSTRING; r : STRING;",
                          "w := STRING_TO_WSTRING(s); r := WSTRING_TO_STRING(w);"))


def test_a_character_that_string_does_not_hold_becomes_a_question_mark():
    assert evaluate("r : STRING;", 'r := WSTRING_TO_STRING("a$20ACb");', "r") == "a?b"


def test_a_long_string_stays_whole():
    text = "x" * 200
    assert evaluate(f"s : STRING := '{text}'; r : WSTRING;", "r := TO_WSTRING(s);", "r") == text


# ---------------------------------------------------------------- BCD and truncation


@pytest.mark.parametrize(("bits", "number", "digits"), [
    ("BYTE", "USINT", 2), ("WORD", "UINT", 4), ("DWORD", "UDINT", 8), ("LWORD", "ULINT", 16),
    ("WORD", "INT", 4), ("BYTE", "UINT", 2)])
def test_bcd_goes_both_ways(bits, number, digits):
    plc = Controller(main(f"x : {bits}; n : {number}; a : {number}; b : {bits};"
                          f"c : {number}; d : {bits};",
                          f"a := {bits}_BCD_TO_{number}(x); b := {number}_TO_BCD_{bits}(n);"
                          f"c := BCD_TO_{number}(x); d := TO_BCD_{bits}(n);"))
    for value in (0, 7, 42, 10**digits - 1, 10**(digits - 1)):
        plc["x"], plc["n"] = int(str(value), 16), value
        plc.scan()
        assert [plc[k] for k in "abcd"] == [value, int(str(value), 16)] * 2


@pytest.mark.parametrize(("call", "reason"), [
    ("WORD_BCD_TO_UINT(16#12A4)", "16#12A4 is no BCD number"),
    ("UINT_TO_BCD_BYTE(100)", "100 has more than 2 BCD digits"),
    ("INT_TO_BCD_WORD(-1)", "more than 4 BCD digits")])
def test_what_bcd_does_not_hold_is_a_fault(call, reason):
    plc = Controller(main("r : LWORD;", f"r := TO_LWORD({call});")).scan()
    assert reason in str(plc.resource.fault)


@pytest.mark.parametrize("value", [0.0, 0.5, 1.5, -1.5, 2.999, -2.999, 100.7])
def test_trunc_drops_the_fraction_in_the_type_around_it(value):
    plc = Controller(main("x : LREAL; a : INT; b : DINT; c : LINT; d : SINT; e : LREAL; f : INT;",
                          "a := TRUNC(x); b := TRUNC(x) + 1; c := TRUNC(x); d := TRUNC_SINT(x);"
                          "e := TRUNC(x); f := LREAL_TRUNC_INT(x);"))
    plc["x"] = value
    plc.scan()
    whole = math.trunc(value)
    assert [plc[k] for k in "abcdef"] == [whole, whole + 1, whole, whole, float(whole), whole]


def test_dates_agree_with_pythons_calendar():
    plc = Controller(main("x : DT; r : STRING;", "r := DT_TO_STRING(x);"))
    for day in range(-100_000, 100_000, 9973):
        then = datetime.datetime(1970, 1, 1) + datetime.timedelta(days=day, seconds=day % 86_400)
        plc["x"] = day * DAY + day % 86_400 * 10**9
        assert plc.scan()["r"] == then.strftime("DT#%Y-%m-%d-%H:%M:%S")


@pytest.mark.parametrize(("name", "meant"), [("INT_TO_SRING", "INT_TO_STRING"),
                                             ("TO_STRNG", "TO_STRING"), ("LEEN", "LEN"),
                                             ("REEL_TO_DINT", "REAL_TO_DINT")])
def test_a_misspelt_function_has_a_hint(name, meant):
    with pytest.raises(CompileError) as error:
        Controller(main("r : INT;", f"r := {name}(r);"))
    assert f"did you mean {meant!r}" in str(error.value)


def test_trunc_takes_what_becomes_a_real_without_loss():
    assert evaluate("x : INT := -5; r : INT;", "r := TRUNC(x) + REAL_TRUNC_INT(x);", "r") == -10


@pytest.mark.parametrize(("call", "value"), [("SEL(TRUE, 1, 16#F0)", 0xF0), ("MUX(1, 1, 2)", 2),
                                             ("MAX(1, 200)", 200), ("MOVE(16#FF)", 255),
                                             ("LIMIT(1, 300, 250)", None)])
def test_selections_of_literals_take_the_bit_string_around_them(call, value):
    text = main("r : BYTE;", f"r := {call};")
    assert (Controller(text).scan()["r"] if value else findings(text)) == (value or ["5:15: P0025"])
