"""Suspensions that no linkage can have: one error that names the file and the point, before anything is built."""

from __future__ import annotations

import dataclasses
import json
from typing import Any

import pytest

from simwarp.vehicle.spec.vehicle_files import DATA, load_vehicle
from simwarp.vehicle.spec.vehicle_spec import SpecError
from tests.physics.sample_vehicles import (
    macpherson_strut,
    multi_link,
    shipped,
    solid_axle,
    trailing_arm,
)

HMMWV: Any = shipped("hmmwv").axles[0].suspension
GATOR: Any = shipped("gator").axles[0].suspension
ON_THE_HINGE = tuple(2.0 * a - b for a, b in zip(HMMWV.lower_arm_front, HMMWV.lower_arm_back, strict=True))

MISTAKES: dict[str, tuple[Any, dict[str, Any], str]] = {
    "two pivots at one place": (HMMWV, {"upper_arm_front": HMMWV.upper_arm_back}, "upper_arm_front: must be apart"),
    "a ball on the hinge": (HMMWV, {"lower_arm_upright": ON_THE_HINGE}, "lower_arm_upright: must be off the line"),
    "a tie rod without length": (HMMWV, {"tierod_chassis": HMMWV.tierod_upright}, "tierod_chassis: must be apart"),
    "an arm without an axis": (GATOR, {"arm_axis": (0.0, 0.0, 0.0)}, "arm_axis: must be a direction"),
    "an arm without length": (GATOR, {"arm_upright": GATOR.arm_chassis}, "arm_chassis: must be apart"),
    "a strut without length": (macpherson_strut(), {"strut_upright": (-0.115, 0.785, 0.579)}, "strut_chassis: must be"),
    "a link without a plane": (multi_link(), {"lateral_upright": (0.0, 0.714, -0.156)}, "lateral_upright: must be"),
    "a trailing link without a spring": (multi_link(), {"springs": ()}, "springs: must be one or more"),
    "half a drag link": (solid_axle(), {"draglink_knuckle": None}, "draglink_knuckle: must be given together"),
    "a knuckle without an axis": (solid_axle(), {"knuckle_upper": (0.005, 0.7, -0.05)}, "knuckle_upper: must be apart"),
    "a pivot without an axis": (trailing_arm(), {"pivot_axis": (0.0, 0.0, 0.0)}, "pivot_axis: must be a direction"),
    "a steering without an axis": (
        shipped("hmmwv").steerings[0].steering, {"idler_axis": (0.0, 0.0, 0.0)}, "idler_axis: must be a direction",
    ),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_linkage_that_cannot_be(mistake):
    description, changes, message = MISTAKES[mistake]
    with pytest.raises(SpecError, match=message):
        dataclasses.replace(description, **changes)


def test_the_file_and_the_key_are_named(tmp_path):
    text = json.loads((DATA / "hmmwv-reduced.json").read_text())
    front = text["axles"][0]["suspension"]
    front["tierod_chassis"] = front["tierod_upright"]
    for axle in text["axles"]:
        axle["tire"] = json.loads((DATA / axle["tire"]["file"]).read_text())
    for key in ("driveline", "engine", "transmission"):
        text[key] = json.loads((DATA / text[key]["file"]).read_text())
    path = tmp_path / "mine.json"
    path.write_text(json.dumps(text))
    with pytest.raises(SpecError, match=r"mine\.json: axles\[0\]\.suspension\.tierod_chassis: must be apart"):
        load_vehicle(path)
