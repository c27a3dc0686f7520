"""Masses too far apart are named when the model is made, where the light one has something to carry."""

from __future__ import annotations

import re
import warnings

import pytest

import simwarp as sw

HEAVY = 10.0


def chain(light: float, links: int, *, weight: bool = True) -> sw.ModelBuilder:
    """Light links under the world, a heavy one at their end."""
    builder = sw.ModelBuilder()
    parent = sw.WORLD
    for link in range(links):
        place = sw.pose((0.0, 0.0, -0.2 * link - 0.1))
        body = builder.add_body(f"link{link}", mass=light, inertia=(1e-2 * light,) * 3, pose=place)
        builder.add_joint_revolute(f"j{link}", parent, body, axis=(0, 1, 0), anchor=(0, 0, -0.2 * link))
        parent = body
    if weight:
        last = builder.add_body("weight", mass=HEAVY, inertia=(0.1,) * 3, pose=sw.pose((0, 0, -0.2 * links - 0.1)))
        builder.add_joint_revolute("jw", parent, last, axis=(0, 1, 0), anchor=(0, 0, -0.2 * links))
    return builder


def under_a_box(light: float) -> sw.ModelBuilder:
    builder = sw.ModelBuilder()
    builder.add_shape_plane()
    builder.add_solid("dust", "box", (0.1, 0.1, 0.1), mass=light, pose=sw.pose((0, 0, 0.1)))
    builder.add_solid("box", "box", (0.1, 0.1, 0.1), mass=HEAVY, pose=sw.pose((0, 0, 0.3)))
    return builder


def in_the_middle(light: float) -> sw.ModelBuilder:
    """Heavy on both sides, and the light one in two parts that are fixed to each other."""
    builder = sw.ModelBuilder()
    top = builder.add_body("top", mass=HEAVY, inertia=(0.1,) * 3)
    half = [builder.add_body(f"half{k}", mass=0.5 * light, inertia=(light,) * 3) for k in range(2)]
    low = builder.add_body("low", mass=1.0, inertia=(0.1,) * 3, pose=sw.pose((0, 0, -1)))
    builder.add_joint_spherical("a", top, half[0], anchor=(0, 0, 0))
    builder.add_joint_fixed("f", half[0], half[1])
    builder.add_joint_revolute("b", half[1], low, axis=(0, 1, 0))
    return builder


@pytest.mark.parametrize("light", [1e-6, 5e-5])
@pytest.mark.parametrize(
    "build", [lambda light: chain(light, 1), lambda light: chain(light, 3), under_a_box, in_the_middle]
)
def test_the_ratio_is_named(build, light):
    ratio = re.escape(f"{HEAVY / light:.2g} times")
    with pytest.warns(UserWarning, match=rf"finalize: body '(link0|dust|half0)' has .* {ratio}") as told:
        build(light).finalize(2, "cpu")
    assert len(told) == 1
    assert told[0].filename == __file__  # who called finalize


def end_of_an_arm(light: float) -> sw.ModelBuilder:
    """A light body at the end, on a hinge: it carries nothing."""
    builder = chain(HEAVY, 2, weight=False)
    tip = builder.add_body("tip", mass=light, inertia=(1e-9,) * 3, pose=sw.pose((0, 0, -0.5)))
    builder.add_joint_revolute("jt", 1, tip, axis=(0, 1, 0), anchor=(0, 0, -0.4))
    return builder


def fixed_frames(light: float) -> sw.ModelBuilder:
    """Light frames fixed to heavy bodies, as robots have them: each is one body with its neighbour."""
    builder = chain(HEAVY, 2, weight=False)
    for body in (0, 1):
        frame = builder.add_body(f"frame{body}", mass=light, inertia=(1e-9,) * 3)
        builder.add_joint_fixed(f"f{body}", body, frame)
    return builder


def apart(light: float) -> sw.ModelBuilder:
    """In mechanisms of their own, without shapes."""
    builder = chain(light, 3, weight=False)
    builder.add_body("weight", mass=HEAVY, inertia=(0.1,) * 3)
    return builder


def massless(light: float) -> sw.ModelBuilder:
    builder = sw.ModelBuilder()
    frame = builder.add_massless_body("frame")
    body = builder.add_body("weight", mass=HEAVY, inertia=(0.1,) * 3)
    builder.add_joint_revolute("a", sw.WORLD, frame, axis=(1, 0, 0))
    builder.add_joint_revolute("b", frame, body, axis=(0, 1, 0))
    return builder


@pytest.mark.parametrize("build", [end_of_an_arm, fixed_frames, apart, massless])
def test_what_carries_nothing_is_not(build):
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        build(1e-6).finalize(1, "cpu")
    assert not seen


@pytest.mark.parametrize("build", [lambda light: chain(light, 3), under_a_box, in_the_middle])
def test_ordinary_ratios_are_not(build):
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        build(1.01e-4).finalize(1, "cpu")
    assert not seen
