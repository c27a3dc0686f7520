"""Files of recorded runs: units and sources of Parquet, refusals in one line, CSV as before."""

import json
import sys

import numpy as np
import pytest

from simwarp.core.files import FileError
from simwarp.core.types import ModelError
from simwarp.exporters.run_tables import check_run_file, read_run, write_run
from simwarp.vehicle.results.channels import COLUMNS, PULLS, SINKAGES, Run
from simwarp.vehicle.results.track_readings import track_columns
from simwarp.vehicle.results.usual_columns import UNITS, meaning_of, unit_of


def made_up(*further: str) -> Run:
    t = np.arange(-1.0, 2.0, 0.01)
    return Run({name: np.sin(t + index) for index, name in enumerate((*COLUMNS, *further))} | {"t_s": t})


@pytest.mark.parametrize("name", [*COLUMNS, *SINKAGES, *PULLS, *track_columns((5, 5))])
def test_every_usual_column_has_a_meaning_and_its_unit(name):
    assert meaning_of(name)
    bare = {"gear", "throttle", "brake", "steer", "slip", "pull_per_weight"}
    assert (unit_of(name) == "1") == (name in bare)


def test_units_are_the_endings_of_names():
    assert [unit_of(name) for name in ("speed_mps", "Fx_FL_N", "reaction:a.Mx_Nm", "ax_mps2", "slip_FL", "N", "")] == [
        "m/s", "N", "N·m", "m/s²", "1", "1", "1",
    ]  # fmt: skip
    assert len(set(UNITS.values())) == len(UNITS)


def test_parquet_holds_units_and_sources(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    run = made_up("Fx_FL_N", "slip_FL")
    write_run(run, tmp_path / "a.parquet", {"vehicle": "größer", "maneuver": "x"}, {"Fx_FL_N": "force on the wheel"})
    table = parquet.read_table(tmp_path / "a.parquet")
    assert table.column_names == list(run.columns)
    for name, values in run.columns.items():
        assert np.array_equal(table.column(name).to_numpy(), values), name
        assert table.schema.field(name).metadata[b"unit"].decode() == unit_of(name)
    assert table.schema.field("Fx_FL_N").metadata[b"meaning"] == b"force on the wheel"
    about = {key: json.loads(table.schema.metadata[key]) for key in (b"units", b"sources", b"simwarp")}
    assert about[b"units"] == {name: unit_of(name) for name in run.columns}
    assert about[b"sources"]["omega_FL_radps"] == "of the wheel seen from the chassis, positive forwards"
    assert (about[b"simwarp"]["vehicle"], about[b"simwarp"]["maneuver"]) == ("größer", "x")
    assert about[b"simwarp"]["version"]


def test_a_run_comes_back_from_either_file(tmp_path):
    pytest.importorskip("pyarrow")
    run = made_up()
    for name, digits in (("a.csv", 1e-8), ("a.parquet", 0.0)):
        write_run(run, tmp_path / name)
        again = read_run(tmp_path / name)
        assert list(again.columns) == list(run.columns)
        for column in run.columns:
            assert np.allclose(again[column], run[column], rtol=digits, atol=digits)


def test_a_broken_parquet_file_is_one_line(tmp_path):
    pytest.importorskip("pyarrow")
    (tmp_path / "bad.parquet").write_bytes(b"PAR1 no")
    with pytest.raises(FileError, match=r"bad.parquet: must be a Parquet file of numbers: [^\n]*$"):
        read_run(tmp_path / "bad.parquet")
    with pytest.raises(FileError, match="must be a Parquet file of numbers"):
        read_run(tmp_path / "none.parquet")


def test_without_the_library_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ModelError) as found:
        check_run_file(tmp_path / "a.parquet", "--output")
    assert str(found.value).startswith("--output: a Parquet file needs the library pyarrow")
    with pytest.raises(ModelError) as late:
        write_run(made_up(), tmp_path / "a.parquet")
    assert all("pip install 'simwarp[parquet]'" in str(error.value) for error in (found, late))
    assert "\n" not in str(found.value)


@pytest.mark.parametrize("name", ["a.txt", "a", "a.parquet.gz", "parquet"])
def test_other_endings_are_refused(tmp_path, name):
    with pytest.raises(FileError, match=r"--output: the name must end in \.csv or \.parquet, got"):
        check_run_file(tmp_path / name, "--output")
