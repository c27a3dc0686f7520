"""Sprockets and grooves of a builder: what is kept of them, what is refused and how."""

from typing import Any

import pytest

import simwarp as sw

GOOD: dict[str, Any] = {
    "arc_center_radius": 0.3, "arc_radius": 0.089, "tip_radius": 0.2605, "teeth": 10, "half_width": 0.1,
}  # fmt: skip
BAD: dict[str, tuple[dict[str, Any], str]] = {
    "no teeth": ({"teeth": 0}, "teeth must be an integer >= 3, got 0"),
    "two teeth": ({"teeth": 2}, "teeth must be an integer >= 3, got 2"),
    "half a tooth": ({"teeth": 9.5}, "teeth must be an integer"),
    "too many teeth": ({"teeth": 11}, "arcs must leave teeth between them: less than 0.2856 rad"),
    "arcs around the axis": (
        {"arc_radius": 0.31},
        "the arcs' bottom, arc_center_radius - arc_radius, must lie between",
    ),
    "tips below the bottom": (
        {"tip_radius": 0.2},
        "the arcs' bottom, arc_center_radius - arc_radius, must lie between",
    ),
    "tips beyond the arcs": ({"tip_radius": 0.4}, "the arcs must reach the tips"),
    "a negative radius": ({"arc_radius": -0.1}, "arc_radius must be finite and > 0 m, got -0.1"),
    "no width": ({"half_width": 0.0}, "half_width must be finite and > 0 m, got 0.0"),
    "a negative offset": ({"arc_offset": -0.1}, "arc_offset must be >= 0 rad, got -0.1"),
    "no angle": ({"arc_offset": float("nan")}, "arc_offset must be a finite number"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_profile_that_is_none_is_refused(case):
    changes, words = BAD[case]
    builder = sw.ModelBuilder()
    with pytest.raises(sw.ModelError, match="shape 'sprocket0': ") as error:
        builder.add_shape_sprocket(sw.WORLD, **{**GOOD, **changes})
    assert words in str(error.value)
    assert "\n" not in str(error.value)
    assert not builder.shapes
    assert not builder.sprocket_profiles


@pytest.mark.parametrize("field", ["radius", "half_width"])
def test_a_groove_has_two_lengths(field):
    lengths: dict[str, Any] = {"radius": 0.3, "half_width": 0.02, field: -1.0}
    with pytest.raises(sw.ModelError, match=f"shape 'groove0': {field} must be finite and > 0 m, got -1.0"):
        sw.ModelBuilder().add_shape_groove(sw.WORLD, **lengths)


def test_equal_profiles_are_one_whatever_their_size():
    builder = sw.ModelBuilder()
    doubled = {name: GOOD[name] * (1 if name == "teeth" else 2) for name in GOOD}
    shapes = [builder.add_shape_sprocket(sw.WORLD, **each) for each in (GOOD, doubled, {**GOOD, "teeth": 9})]
    assert [builder.shapes[shape].asset for shape in shapes] == [0, 0, 1]
    assert builder.shapes[shapes[1]].size.tolist() == [0.521, 0.2, 0.521]


@pytest.mark.parametrize(("radius", "room"), [(0.089, "0.089 m"), (0.02, "0.02 m")])
def test_balls_that_do_not_fit_are_refused(radius, room):
    builder = sw.ModelBuilder()
    ball = builder.add_body("ball", mass=1.0, inertia=(1.0, 1.0, 1.0))
    if radius > 0.05:
        builder.add_shape_sprocket(sw.WORLD, **GOOD)
    else:
        builder.add_shape_groove(sw.WORLD, radius=0.3, half_width=0.02)
    builder.add_shape_sphere(ball, radius=radius, name="ball")
    with pytest.raises(sw.ModelError, match=f"must be smaller than its {room}, got 'ball' of {radius} m; part them by"):
        builder.finalize(1, "cpu")


def test_only_spheres_are_given_as_partners():
    builder = sw.ModelBuilder()
    body = builder.add_body("body", mass=1.0, inertia=(1.0, 1.0, 1.0))
    sprocket = builder.add_shape_sprocket(sw.WORLD, **GOOD, mask=0)
    box = builder.add_shape_box(body, half=(0.1, 0.1, 0.1))
    with pytest.raises(sw.ModelError, match="sprockets and grooves meet spheres only, got 'sprocket0' and 'box1'"):
        builder.add_shape_pair(sprocket, box)
    for kind in ("sprocket", "groove"):
        with pytest.raises(sw.ModelError, match="kind must be"):
            builder.add_solid("solid", kind, (0.1, 0.1, 0.1), mass=1.0)
