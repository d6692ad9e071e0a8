"""`plcemu check --export il`: nets as Instruction List on stdout, diagnostics elsewhere."""

import json

from systems import ROOT

from plcemu.cli.main import main
from plcemu.lang.compile import compile_program

TANK = ROOT / "il_programs/heating_tank"


def test_the_exported_text_is_all_of_stdout_and_compiles(capsys):
    assert main(["check", "--export", "il", str(TANK / "version4.sipn")]) == 0
    told = capsys.readouterr()
    assert "PLACE" not in told.out
    assert compile_program(told.out).instances[0].name == "TANK"
    assert "P0115" in told.err


def test_a_wrong_net_is_not_exported(tmp_path, capsys):
    path = tmp_path / "wrong.sipn"
    path.write_text((TANK / "version5.sipn").read_text("utf-8").replace("TO P4", "TO P8"))
    assert main(["check", "--export", "il", "--json", str(path)]) == 1
    document = json.loads(capsys.readouterr().out)
    assert (document["ok"], [d["code"] for d in document["diagnostics"]]) == (False, ["P0110"])
