"""The tables of docs/tracks.md are those of the code."""

import inspect
import re
from pathlib import Path

import simwarp as sw
from simwarp.vehicle import TrackedVehicle, add_tracked_vehicle, load_tracked_vehicle, maneuver, per_world
from simwarp.vehicle.driving.maneuvers import maneuver_options
from simwarp.vehicle.driving.track_maneuvers import TRACK_MANEUVERS
from simwarp.vehicle.results.track_readings import track_columns

PAGE = (Path(__file__).resolve().parents[4] / "docs" / "tracks.md").read_text(encoding="utf-8")
SPEC = load_tracked_vehicle("m113")


def rows(first):
    """Cells of the table whose head begins with a cell."""
    found, inside = [], False
    for line in PAGE.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if not line.startswith("|"):
            inside = False
        elif cells[0] == first:
            inside = True
        elif inside and not line.startswith("|--"):
            found.append(cells)
    return found


def test_the_manoeuvres_are_listed_with_their_options():
    listed = {row[0].strip("`"): row for row in rows("manoeuvre on tracks")}
    assert list(listed) == list(TRACK_MANEUVERS)
    for name, row in listed.items():
        assert re.findall(r"`(\w+)`", row[2]) == maneuver_options(name, TRACK_MANEUVERS)
        defaults = {key: each.default for key, each in inspect.signature(TRACK_MANEUVERS[name]).parameters.items()}
        for key, number in re.findall(r"`(\w+)` ([\d.]+)", row[2]):
            assert defaults[key] == float(number), (name, key)
        if row[3] != "`duration`":
            assert maneuver(name, SPEC).duration == float(row[3])


def test_the_columns_are_listed():
    listed = {name for row in rows("recorded") for name in re.findall(r"`(\w+)`", row[0])}
    arms = {f"arm_{side}{k}_rad" for side in "LR" for k in range(5)}
    assert {"arm_L0_rad", "arm_R4_rad"} < listed
    assert listed | arms == set(track_columns((5, 5)))


def test_the_arrays_that_are_listed_exist():
    builder = sw.ModelBuilder()
    parts = add_tracked_vehicle(builder, SPEC)
    vehicle = TrackedVehicle(parts, builder.finalize(3, "cpu", per_world=per_world()))
    for names, shape, _ in rows("array of tracks"):
        wanted = tuple(
            3 if size.strip() == "W" else int(size) for size in shape[1:].partition(")")[0].split(",") if size
        )
        for name in re.findall(r"`(\w+)`", names):
            assert getattr(vehicle, name).shape == wanted, name
