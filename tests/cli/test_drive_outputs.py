"""`simwarp drive`: --output by suffix, --report, and channels of torques."""

import dataclasses
import json
import sys

import numpy as np
import pytest

from simwarp.cli.view.drive_film import DriveFilm
from simwarp.core import warp_start
from simwarp.vehicle.results.channels import Run
from simwarp.vehicle.spec.vehicle_files import save_vehicle
from tests.physics.sample_vehicles import shipped
from tests.unit.exporters.test_run_report import Page, external

MASS = ("--vary", "chassis.components[0].mass=-5%..5%", "--worlds", "2")
TURN = ("gator", "--maneuver", "constant-radius", "--duration", "0.3")


def test_a_run_goes_into_parquet_with_its_units(command, tmp_path, monkeypatch):
    parquet = pytest.importorskip("pyarrow.parquet")
    monkeypatch.chdir(tmp_path)
    code, out, err = command(
        "drive", *TURN, "--channels", "torque_*,steeringwheel_*", "--output", "a.parquet", "--csv", "a.csv",
        "--json", "a.json",
    )  # fmt: skip
    assert (code, err) == (0, "")
    assert "wrote a.parquet" in out
    table, run = parquet.read_table("a.parquet"), Run.read(tmp_path / "a.csv")
    assert table.column_names == list(run.columns)
    assert table.schema.field("torque_RL_Nm").metadata[b"unit"].decode() == "N·m"
    for name in run.columns:
        # nine digits are written
        assert np.allclose(table.column(name).to_numpy(), run[name], rtol=1e-8, atol=1e-12)
    about = json.loads(table.schema.metadata[b"simwarp"])
    assert (about["vehicle"], about["maneuver"], about["duration"]) == ("gator", "constant-radius", "0.3 s")
    assert json.loads((tmp_path / "a.json").read_text())["output"] == "a.parquet"


def test_an_output_of_csv_is_that_of_csv(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert command("drive", *TURN, "--csv", "a.csv", "--output", "b.csv")[0] == 0
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()
    run = Run.read(tmp_path / "a.csv")
    # forwards is positive
    assert all(run[f"omega_{wheel}_radps"][-1] > 0.0 for wheel in ("FL", "FR", "RL", "RR"))


@pytest.mark.parametrize("first", [("drive", *TURN), ("drive", *TURN, *MASS), ("rig", "tire", "gator")])
def test_rows_go_to_a_file_of_their_kind(command, tmp_path, monkeypatch, first):
    monkeypatch.chdir(tmp_path)
    assert command(*first, "--csv", "x.txt")[::2] == (2, "simwarp: --csv must end in .csv, got 'x.txt'\n")
    assert list(tmp_path.iterdir()) == []


def test_worlds_that_do_the_same_are_called_so(command):
    code, out, _ = command("drive", *TURN, "--worlds", "4")
    assert code == 0
    assert out.splitlines()[-1].startswith("4 worlds that did the same, ")
    assert out.splitlines()[-1].endswith(" steps/s; --vary KEY=LOW..HIGH lets them differ")
    assert command("drive", *TURN)[1].splitlines()[-1].startswith("1 world, ")


def test_whatever_a_drive_compiles_is_reported(command, tmp_path, monkeypatch):
    """Kernels of cameras are compiled when a film is begun and when its pictures are made."""
    monkeypatch.chdir(tmp_path)
    real, seen = (DriveFilm.__init__, DriveFilm.write), []

    def seen_first(method):
        def called(self, *arguments):
            seen.append((method.__name__, warp_start._busy.locked()))
            return method(self, *arguments)

        return called

    monkeypatch.setattr(DriveFilm, "__init__", seen_first(real[0]))
    monkeypatch.setattr(DriveFilm, "write", seen_first(real[1]))
    assert command("drive", *TURN, "--video", "a.png")[0] == 0
    assert seen == [("__init__", True), ("write", True)]


@pytest.mark.slow
def test_a_report_tells_the_run_and_opens_offline(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, err = command(
        "drive", "gator", "--maneuver", "hill-start", "--duration", "3", "--report", "a.html", "--json", "a.json"
    )
    assert (code, err) == (0, "")
    assert "wrote a.html" in out
    text, content = (tmp_path / "a.html").read_text(encoding="utf-8"), json.loads((tmp_path / "a.json").read_text())
    page = Page(text)
    assert external(page) == []
    assert not any(word in text for word in ("http:", "https:"))
    words = page.words
    assert ("passed" if content["passed"] else "failed") in words
    assert content["verdicts"]
    for verdict in content["verdicts"]:
        assert verdict["rule"] in words
    told = [f"{value:.4g}" for value in content["results"].values() if value is not None and abs(value) > 5e-5]
    assert len(told) > 2
    assert set(told) <= set(words)
    pictures = page.pictures
    assert len(pictures) == 2
    for picture in pictures:
        picture.load()
        assert np.asarray(picture.convert("L")).std() > 5.0  # not one colour


@pytest.mark.slow
def test_a_report_of_an_own_vehicle_draws_its_links_and_tells_how_it_stands(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_vehicle(dataclasses.replace(shipped("hmmwv"), name="truck"), "truck.json")
    code, _, err = command(
        "drive", "truck.json", "--maneuver", "constant-radius", "--duration", "0.1", "--report", "a.html"
    )
    assert (code, err) == (0, "")
    page = Page((tmp_path / "a.html").read_text(encoding="utf-8"))
    assert external(page) == []
    assert {"as built", "at rest", "axle 1: track", "centre of mass above the ground"} <= set(page.words)
    told = [word for word in page.words if "mm higher over axle" in word]
    assert len(told) == 2  # as recorded: a tenth of a metre above its design
    assert any("drawn from its description" in word for word in page.words)
    units = dict(zip(page.words, page.words[2:], strict=False))
    assert units["tire: load"] == "N"
    assert any(word.startswith("spring 1: rate at rest") for word in page.words)
    # springs are the only yellow parts: redder than blue by half, and not of the box's red
    red, green, blue = np.moveaxis(np.asarray(page.pictures[-1].convert("RGB"), float), 2, 0)
    assert ((red > 1.5 * blue) & (green > 1.4 * blue)).sum() > 300


@pytest.mark.slow
def test_a_report_of_tracks_has_their_vehicle(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, _, err = command("drive", "m113-belt", "--duration", "0.2", "--report", "a.html")
    assert (code, err) == (0, "")
    page = Page((tmp_path / "a.html").read_text(encoding="utf-8"))
    assert "distance of the tracks" in page.words
    assert len(page.pictures) == 2


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--output", "a.txt"], "--output: the name must end in .csv or .parquet, got 'a.txt'"),
        (["--output", "/nowhere/a.csv"], "--output: cannot write '/nowhere/a.csv': folder /nowhere does not exist"),
        (["--output", "a.csv", "--csv", "a.csv"], "would overwrite 'a.csv', which is --csv too"),
        (["--report", "a.pdf"], "--report: the name must end in .html, got 'a.pdf'"),
        (["--report", "."], "--report must name a file"),
        (["--report", "/nowhere/a.html"], "--report: cannot write '/nowhere/a.html'"),
        (["--maneuver", "iso-3888-1", "--speeds", "5,6", "--report", "a.html"], "--report: is of one run"),
        (["--maneuver", "iso-3888-1", "--speeds", "5,6", "--output", "a.csv"], "--output: is of one run"),
    ],
)
def test_wrong_files_are_one_line(command, tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    code, out, err = command("drive", "gator", *arguments)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert words in err
    assert list(tmp_path.iterdir()) == []


def test_parquet_without_its_library_is_one_line(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    code, out, err = command("drive", "gator", "--output", "a.parquet")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "needs the library pyarrow" in err
    assert "simwarp[parquet]" in err


def test_channels_of_torques_are_listed(command):
    code, out, _ = command("drive", "gator", "--channels", "list", "--json", "-")
    names = {row["name"]: row["unit"] for row in json.loads(out)["channels"]}
    assert code == 0
    assert {"torque_RL_Nm", "torque_RR_Nm", "steeringwheel_rad", "steeringwheel_Nm"} <= set(names)
    assert "torque_FL_Nm" not in names  # its front axle is not driven
    assert names["torque_RL_Nm"] == "N·m"
