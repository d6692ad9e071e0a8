"""Files of other tools: other time columns, units, separators, scopes and timescales."""

import pytest
import vcdvcd

from plcemu.base.errors import PlcemuError, TraceFormatError
from plcemu.base.foreign import Reading
from plcemu.base.tags import Tag, TagTable
from plcemu.base.trace import Frame, Trace
from plcemu.base.tracefile import load, save

MS = 1_000_000


def written(folder, text, name="other.csv"):
    (folder / name).write_text(text, encoding="utf-8")
    return folder / name


@pytest.mark.parametrize(("text", "reading"), [
    ("time_s,pump,level\n0,0,1.5\n0.25,1,2\n", Reading()),
    ("Time [ms];pump;level\n0;FALSE;1.5\n250;TRUE;2\n", Reading()),
    ("t\tpump\tlevel\n0\tfalse\t1.5\n2.5e5\ttrue\t2\n", Reading(unit="us")),
    ("pump,clock,level\n0,0,1.5\n1,250,2\n", Reading(time="CLOCK", unit="ms")),
    ("pump|when|level\n0|2026-01-01T10:00:00Z|1.5\n1|2026-01-01T10:00:00.250Z|2\n",
     Reading(time="when", unit="date", delimiter="|")),
    ("\ufefftime_s, CH1 , level\n0,0,1.5\n\n0.25,0,1.7\n0.25,1,2\n",
     Reading(names={"CH1": "pump"})),
])
def test_a_table_is_read_whatever_its_time_column_is(tmp_path, text, reading):
    trace = load(written(tmp_path, text), reading)
    assert trace.history("pump") == [(0, False), (250 * MS, True)]
    assert trace.history("level") == [(0, 1.5), (250 * MS, 2.0)]


@pytest.mark.parametrize(("text", "reading", "message"), [
    ("a,b\n1,2\n", Reading(), "--time COLUMN says"),
    ("time,b\n1,2\n", Reading(), "say the unit of 'time'"),
    ("time,b\n1,2\n", Reading(time="tme", unit="s"), "no column 'tme'; did you mean 'time'"),
    ("time,b\nx,2\n", Reading(unit="s"), ":2: found 'x', expected a number of s"),
    ("time,b\nnan,2\n", Reading(unit="s"), ":2: found 'nan'"),
    ("time,b\n5,2\n4,2\n", Reading(unit="ms"), ":3: found the instant 4000000 ns, expected one"),
    ("time,b\n5,2,9\n", Reading(unit="ms"), ":2: found 3 columns, expected 2"),
    ("time,b\nnoon,2\n", Reading(unit="date"), "expected a date and time"),
])
def test_a_table_that_does_not_fit_is_told_with_its_line(tmp_path, text, reading, message):
    with pytest.raises(TraceFormatError) as caught:
        load(written(tmp_path, text), reading)
    assert message in str(caught.value)


def test_renaming_to_a_name_that_is_there_is_refused(tmp_path):
    path = written(tmp_path, "t_ns,a,b\n0,1,0\n")
    with pytest.raises(PlcemuError, match="two tags"):
        load(path, Reading(names={"a": "b"}))


VCD = """$date today $end $version some simulator 1.0 $end
$timescale 100 ps $end
$scope module top $end
$scope module tank $end
$var wire 1 ! pump $end
$var reg 8 " level [7:0] $end
$upscope $end
$var real 64 # temp $end
$upscope $end
$enddefinitions $end
#0
$dumpvars
0!
b00000101 "
r1.5 #
$end
#20000000
1!
#20000004
b110 "
#30000000
"""


def test_a_dump_of_another_tool_is_read_with_its_scopes_and_timescale(tmp_path):
    trace = load(written(tmp_path, VCD, "other.vcd"))
    assert trace.history("top.tank.pump") == [(0, False), (2 * MS, True)]
    assert trace.history("temp") == [(0, 1.5)]
    level = next(tag.name for tag in trace.tags if "level" in tag.name)
    assert trace.history(level) == [(0, 5), (2 * MS, 6)]
    assert trace.end_ns == 3 * MS


def test_an_independent_reader_finds_the_same_changes_in_our_dump(tmp_path):
    tags = TagTable([Tag("MAIN.pump", "BOOL"), Tag("MAIN.FILL.X", "BOOL"),
                     Tag("plant.level", "LREAL"), Tag("MAIN.count", "UINT")])
    trace = Trace(tags)
    trace.observe(Frame(0, 0, ((0, False), (1, True), (2, 0.5), (3, 0))))
    for n in range(1, 30):
        trace.observe(Frame(n * 10 * MS, n, ((0, bool(n % 2)), (2, n / 3), (3, n))))
    save(trace, tmp_path / "run.vcd")
    found = vcdvcd.VCDVCD(str(tmp_path / "run.vcd"))
    names = {name.split("[")[0]: name for name in found.signals}
    assert found.timescale["timescale"] * 10**9 == 1

    def changes(name, convert):
        return [(t, convert(text)) for t, text in found[names[name]].tv]

    assert changes("MAIN.pump", lambda bit: bit == "1") == trace.history("MAIN.pump")
    assert changes("MAIN.FILL.X", lambda bit: bit == "1") == trace.history("MAIN.FILL.X")
    assert changes("plant.level", float) == trace.history("plant.level")
    assert changes("MAIN.count", lambda bits: int(bits, 2)) == trace.history("MAIN.count")
