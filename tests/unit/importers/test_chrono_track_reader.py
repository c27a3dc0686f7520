"""Chrono's tracked vehicle files, as they are: the shipped vehicle, other templates, mistakes named.

`chrono_track_files.json` holds values of Project Chrono's data/vehicle (commit 7689fbc, BSD-3-Clause): path -> file.
"""

import copy
import dataclasses
import json
import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from simwarp.importers.chrono_tracks import load_chrono_tracked_vehicle
from simwarp.vehicle.spec.drivetrain_parts import AutomaticShafts, EngineShafts
from simwarp.vehicle.spec.parts import SpecError
from simwarp.vehicle.spec.track_parts import BrakedDifferential, DoublePinShoe, DoublePinSprocket
from simwarp.vehicle.tracks.tracked_files import load_tracked_vehicle

VALUES = json.loads((Path(__file__).parent / "chrono_track_files.json").read_text(encoding="utf-8"))
CHRONO = Path(__file__).parents[4] / "shared/reference/chrono/vehicles"
SINGLE, DOUBLE = (f"M113/vehicle/M113_Vehicle_{name}.json" for name in ("SinglePin", "DoublePin_BDS"))
LEFT = "M113/track_assembly/M113_TrackAssemblySinglePin_Left.json"


def read(root: Path, vehicle: str = SINGLE, values: dict[str, Any] = VALUES) -> Any:
    """The vehicle, from files in a temporary folder; Chrono's files have comments."""
    for path, value in values.items():
        file = root / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("// a comment\n" + json.dumps(value, indent=1))
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*Contact: left out")
        return load_chrono_tracked_vehicle(root / vehicle)


def test_the_shipped_vehicle_is_that_of_the_files(tmp_path):
    """But for the right idler, which stands 5 cm further back there than in the model that was recorded."""
    shipped, found = load_tracked_vehicle("m113"), read(tmp_path)
    assert found.right.idler_location == (-4.0, 0.0, -0.12)
    right = dataclasses.replace(found.right, idler_location=found.left.idler_location)
    chosen = {name: getattr(shipped, name) for name in ("name", "start_height", "driveline", "engine", "transmission")}
    assert dataclasses.replace(found, right=right, **chosen) == shipped


def test_engine_and_gearbox_come_from_files_of_their_own():
    """Whose torques are rounded to 1 N·m, and whose curves are over rpm; ours are over rad/s."""
    if not CHRONO.exists():
        pytest.skip("the files of the other simulator are not here")
    engine, gears = (CHRONO / f"M113/powertrain/M113_{name}Shafts.json" for name in ("Engine", "AutomaticTransmission"))
    shipped = load_tracked_vehicle("m113")
    assert isinstance(shipped.engine, EngineShafts)
    assert isinstance(shipped.transmission, AutomaticShafts)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*Contact: left out")
        path = CHRONO / "M113/vehicle/M113_Vehicle_SinglePin_BDS.json"
        found = load_chrono_tracked_vehicle(path, engine=engine, transmission=gears)
    assert isinstance(found.engine, EngineShafts)
    np.testing.assert_allclose(shipped.engine.torque, found.engine.torque, atol=1.0)
    np.testing.assert_allclose(shipped.engine.losses, found.engine.losses, atol=1.0)
    assert isinstance(found.transmission, AutomaticShafts)
    np.testing.assert_allclose(found.transmission.forward_ratios, shipped.transmission.forward_ratios, atol=1e-3)
    assert found.transmission.upshift_speed == pytest.approx(shipped.transmission.upshift_speed)
    assert found.driveline == shipped.driveline


def test_points_are_those_of_the_left_side(tmp_path):
    spec = read(tmp_path)
    for track in (spec.left, spec.right):
        hinges = [mount.suspension.hinge for mount in track.road_wheels]
        assert hinges == [(0.288, -0.12, 0.134)] * 5
        assert track.idler.carrier.com == (0.0, -0.1, 0.0)
    shocks = [mount.suspension.shock is not None for mount in spec.left.road_wheels]
    assert shocks == [True, True, False, False, True]


def test_double_pins(tmp_path):
    spec = read(tmp_path, DOUBLE)
    track = spec.left
    assert isinstance(track.shoe, DoublePinShoe)
    assert isinstance(track.sprocket, DoublePinSprocket)
    assert math.isclose(track.shoe.pitch, 0.1524)
    assert track.shoe.joined
    assert track.shoe.lengths == (0.0984, 0.054)
    assert (track.pin_stiffness, track.pin_damping) == (1000.0, 10.0)
    assert isinstance(spec.driveline, BrakedDifferential)
    assert spec.driveline.bevel_ratio == 0.5


def changed(path: str, *keys: str | int, value: Any) -> dict[str, Any]:
    """The files with one value in the place of another."""
    values = copy.deepcopy(VALUES)
    place: Any = values[path]
    for key in keys[:-1]:
        place = place[key]
    place[keys[-1]] = value
    return values


MISTAKES: dict[str, tuple[dict[str, Any], str]] = {
    "a band": (changed(LEFT, "Template", value="TrackAssemblyBandANCF"), r"Left\.json: Template: must be one of"),
    "one track": (changed(SINGLE, "Track Assemblies", value=[]), "Assemblies: must be two, left and right, got 0"),
    "two left tracks": (
        changed(SINGLE, "Track Assemblies", 1, "Offset", value=1.0795), "Track Assemblies: must be equal, the left one",
    ),
    "an unknown key": (changed(LEFT, "Rolers", value=[]), r"Left\.json: Rolers: unknown key .did you mean 'Rollers'"),
    "no teeth": (
        changed("M113/sprocket/M113_SprocketSinglePin_Left.json", "Number Teeth", value=0),
        r"M113_SprocketSinglePin_Left\.json.*must be at least 3, got 0",
    ),
    "a tensioner that slackens": (
        changed("M113/idler/M113_DoubleIdler_Left.json", "Tensioner", "Preload", value=-3e5),
        r"M113_DoubleIdler_Left\.json.*must leave a force > 0 N",
    ),
    "shoes that overlap": (
        changed("M113/track_shoe/M113_TrackShoeSinglePin.json", "Shoe", "Pitch", value=0.1),
        r"M113_TrackShoeSinglePin\.json.*shoes would overlap",
    ),
    "a shoe without pads": (
        changed("M113/track_shoe/M113_TrackShoeSinglePin.json", "Contact", "Shoe Shapes", value=[]),
        "Shoe Shapes: must have a box with and one without Ground Contact",
    ),
    "another idler": (
        changed("M113/idler/M113_DoubleIdler_Left.json", "Template", value="DistanceIdler"),
        "Template: must be one of TranslationalIdler, got 'DistanceIdler'",
    ),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_name_file_and_key(mistake, tmp_path):
    values, message = MISTAKES[mistake]
    with pytest.raises(SpecError, match=message) as error:
        read(tmp_path, values=values)
    assert "\n" not in str(error.value)
