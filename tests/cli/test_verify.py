"""`simwarp verify`: the contract of its options, exit codes and JSON. What it verifies is tests/physics."""

import json

import pytest

from simwarp import verify
from simwarp.cli import main
from simwarp.verify.check_result import near

KEYS = {"scene", "quantity", "expected", "got", "tolerance", "pass", "known"}


def test_one_scene_prints_a_table_and_passes(capsys):
    assert main(["verify", "limits"]) == 0
    out = capsys.readouterr().out
    # units are in brackets, which a console must not take for markup
    assert "rests on the stop at [rad]" in " ".join(out.split())
    assert "FAIL" not in out


def test_json_has_the_rows_that_scripts_rely_on(capsys):
    assert main(["verify", "pendulum", "reactions", "--json", "-"]) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert {row["scene"] for row in rows} == {"pendulum", "reactions"}
    assert all(set(row) == KEYS for row in rows)
    assert all(row["pass"] is True for row in rows)


def test_a_missed_answer_ends_with_one_and_is_still_written(monkeypatch, tmp_path, capsys):
    def wrong(device: str) -> list:
        """Wrong on purpose."""
        assert device == "cpu"
        return [near("pendulum", "period [s]", 1.0, 2.0, 0.1), near("pendulum", "nothing", 0.0, float("nan"), 1.0)]

    monkeypatch.setitem(verify.SCENES, "pendulum", wrong)
    file = tmp_path / "rows.json"
    assert main(["verify", "pendulum", "--json", str(file)]) == 1
    assert "FAIL" in capsys.readouterr().out
    content = json.loads(file.read_text())
    assert [row["pass"] for row in content["rows"]] == [False, False]
    assert content["rows"][1]["got"] is None  # JSON has no word for NaN
    assert (content["passed"], content["known"], content["failed"]) == (0, 0, 2)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["pendulm"], "did you mean pendulum"),
        (["zzz"], "scenes: pendulum"),
        (["pendulum", "--device", "cuda:9"], "not available"),
        (["pendulum", "--json", "/nowhere/at/all.json"], "does not exist"),
    ],
)
def test_wrong_input_is_one_line_and_code_two(arguments, words, capsys):
    assert main(["verify", *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert len(captured.err.strip().splitlines()) == 1
    assert words in captured.err
