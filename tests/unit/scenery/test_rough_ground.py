"""Patches of rough ground: level where a robot starts, as high, steep and wide as their level says, from a seed."""

from __future__ import annotations

import dataclasses
import itertools
import math
from typing import Any

import numpy as np
import pytest

from simwarp.core.types import ModelError
from simwarp.scenery import LEVELS, GroundKind, GroundPatch, ground_patch, level_colors

PATCH = GroundPatch()
SEEDED = (GroundKind.ROUGH, GroundKind.WAVES, GroundKind.STEPS, GroundKind.STONES)
# greatest height above or depth below 0, of kinds whose seed gives a pattern that is only scaled
SCALED = {GroundKind.ROUGH: PATCH.roughness, GroundKind.WAVES: PATCH.waves, GroundKind.STEPS: PATCH.step}
AXIS = np.linspace(-0.5 * PATCH.side, 0.5 * PATCH.side, round(PATCH.side / PATCH.spacing) + 1)
RING = np.maximum(np.abs(AXIS)[:, None], np.abs(AXIS)[None])
RADIUS = np.hypot(AXIS[:, None], AXIS[None])
MIDDLE = len(AXIS) // 2
LONE: Any = 0.1


def linear(pair, level):
    return pair[0] + (pair[1] - pair[0]) * level / (LEVELS - 1)


def outwards(heights):
    """(4, n) profiles from the middle along +x, -x, +y, -y."""
    return np.stack([
        heights[MIDDLE, MIDDLE:], heights[MIDDLE, MIDDLE::-1], heights[MIDDLE:, MIDDLE], heights[MIDDLE::-1, MIDDLE],
    ])  # fmt: skip


def triangle_slopes(heights):
    """Tangents of the slopes of all triangles; cells are cut from node (i, j) to node (i + 1, j + 1)."""
    low, right, above, high = heights[:-1, :-1], heights[:-1, 1:], heights[1:, :-1], heights[1:, 1:]
    below = np.hypot(right - low, high - right)
    return np.stack([below, np.hypot(high - above, above - low)]) / PATCH.spacing


@pytest.mark.parametrize("level", range(LEVELS))
@pytest.mark.parametrize("kind", GroundKind)
def test_middle_and_border_are_level(kind, level):
    heights = ground_patch(kind, level, seed=4)
    assert heights.shape == (161, 161)
    assert heights.dtype == np.float32
    assert np.isfinite(heights).all()
    around = RADIUS if kind in (GroundKind.SLOPE_UP, GroundKind.SLOPE_DOWN) else RING
    assert (heights[around <= 0.5 * PATCH.platform + 1e-9] == 0.0).all()
    # feet of a robot whose base is on the rim are on the same level
    rim = heights[0.5 * PATCH.side - PATCH.rim - 1e-9 <= RING]
    assert np.ptp(rim) == 0.0
    if kind not in (GroundKind.SLOPE_UP, GroundKind.SLOPE_DOWN, GroundKind.STAIRS_UP, GroundKind.STAIRS_DOWN):
        assert rim[0] == 0.0
    assert np.abs(heights).max() <= 1.2 + 1e-6


@pytest.mark.parametrize("level", range(LEVELS))
def test_slopes_are_as_steep_as_said_in_all_directions(level):
    angle = linear(PATCH.slope, level)
    assert linear(PATCH.slope, 9) == pytest.approx(math.radians(25.0))
    for kind, sign in ((GroundKind.SLOPE_UP, 1.0), (GroundKind.SLOPE_DOWN, -1.0)):
        heights = ground_patch(kind, level)
        rise = np.diff(outwards(heights), axis=1)[:, 20:70] / PATCH.spacing
        # float32 heights of up to 1.2 m, over 5 cm
        np.testing.assert_allclose(sign * rise, math.tan(angle), atol=5e-6)
        # triangles take both parts of the gradient from edges that lie apart, by 5 cm at a radius of 1 m
        assert triangle_slopes(heights).max() == pytest.approx(math.tan(angle), rel=0.05)
        away = RADIUS[(RADIUS >= 1.0) & (RADIUS <= 3.5)]
        expected = sign * math.tan(angle) * (away - 1.0)
        np.testing.assert_allclose(heights[(RADIUS >= 1.0) & (RADIUS <= 3.5)], expected, atol=1e-6)


@pytest.mark.parametrize("level", range(LEVELS))
def test_every_stair_is_as_high_as_said(level):
    riser = linear(PATCH.riser, level)
    assert linear(PATCH.riser, 9) == pytest.approx(0.15)
    for kind, sign in ((GroundKind.STAIRS_UP, 1.0), (GroundKind.STAIRS_DOWN, -1.0)):
        heights = ground_patch(kind, level).astype(float)
        for profile in outwards(heights):
            step = sign * np.diff(profile)
            edges = np.flatnonzero(step)
            # one riser, as wide as a cell, every 30 cm, beginning at the platform
            assert edges.tolist() == [20 + 6 * index for index in range(8)]
            np.testing.assert_allclose(step[edges], riser, atol=1e-7)
        # rings about the platform: no other height between them, in the corners either
        np.testing.assert_allclose(heights / (sign * riser), np.rint(heights / (sign * riser)), atol=1e-5)
        assert all(np.ptp(heights[np.abs(RING - ring) < 1e-9]) == 0.0 for ring in AXIS[MIDDLE:])


@pytest.mark.parametrize("kind", SCALED)
@pytest.mark.parametrize("seed", [0, 7])
def test_a_pattern_grows_with_the_level_and_is_as_high_as_said(kind, seed):
    patches = [ground_patch(kind, level, seed).astype(float) for level in range(LEVELS)]
    for level, heights in enumerate(patches):
        assert np.abs(heights).max() == pytest.approx(linear(SCALED[kind], level), rel=1e-6)
        np.testing.assert_allclose(heights * SCALED[kind][1], patches[9] * linear(SCALED[kind], level), atol=1e-7)
    assert np.diff([np.abs(heights).max() for heights in patches]).min() > 0.0
    # ground on both sides of 0
    assert patches[9].min() < -0.4 * SCALED[kind][1]
    assert patches[9].max() > 0.4 * SCALED[kind][1]


def runs(deep):
    """Lengths of the runs of True in a line that have False on both sides."""
    edges = np.flatnonzero(np.diff(deep.astype(int)))
    return [int(b - a) for a, b in itertools.pairwise(edges) if deep[a + 1]]


@pytest.mark.parametrize("seed", [0, 5])
def test_stones_shrink_and_the_gaps_between_them_grow(seed):
    covered = []
    for level in range(LEVELS):
        heights = ground_patch(GroundKind.STONES, level, seed)
        deep = heights == np.float32(-PATCH.depth)
        gap, side = (
            round(linear(PATCH.stride, level) / PATCH.spacing),
            round(linear(PATCH.stone, level) / PATCH.spacing),
        )
        # lines between rows of stones are deep from rim to rim, or up to the platform: longer than any gap
        gaps = [run + 1 for line in deep for run in runs(line) if run < 40]
        assert max(gaps) == gap
        stones = [run - 1 for line in ~deep for run in runs(line)]
        assert max(stones, key=stones.count) == side
        tops = heights[~deep & (RING > 1.0) & (RING < 3.5)]
        assert 0.0 < np.abs(tops).max() <= 0.1 * gap * PATCH.spacing + 1e-6
        covered.append((~deep).mean())
    assert np.diff(covered).max() < 0.01
    assert covered[0] > 0.75
    assert covered[9] < 0.6


def test_gaps_become_wider():
    widths = []
    for level in range(LEVELS):
        heights = ground_patch(GroundKind.GAPS, level)
        found = [[run + 1 for run in runs(line < 0.0)] for line in outwards(heights)]
        assert all(line == found[0] for line in found)
        assert len(set(found[0])) == 1
        assert len(found[0]) >= 2
        assert set(np.unique(heights)) == {np.float32(-PATCH.depth), np.float32(0.0)}
        widths.append(found[0][0] * PATCH.spacing)
    np.testing.assert_allclose(widths, [linear(PATCH.gap, level) for level in range(LEVELS)], atol=1e-9)


def test_flat_ground_is_flat():
    assert all((ground_patch(GroundKind.FLAT, level) == 0.0).all() for level in range(LEVELS))


@pytest.mark.parametrize("kind", GroundKind)
def test_a_seed_tells_the_pattern(kind):
    first = ground_patch(kind, 6, seed=1)
    assert np.array_equal(first, ground_patch(kind.value, 6, seed=1))
    assert np.array_equal(first, ground_patch(kind, 6, seed=2)) == (kind not in SEEDED)


def test_kinds_with_the_same_seed_have_nothing_to_do_with_each_other():
    between = (RING > 1.5) & (RING < 3.0)
    for seed in range(5):
        rough, steps = (ground_patch(kind, 9, seed)[between] for kind in (GroundKind.ROUGH, GroundKind.STEPS))
        # 27 m² of noise with 25 independent places a square metre: five deviations of the correlation of 680 of them
        assert abs(np.corrcoef(rough, steps)[0, 1]) < 0.2


@pytest.mark.parametrize("spacing", [0.1, 0.025])
def test_other_spacings_have_the_same_sizes(spacing):
    patch = dataclasses.replace(PATCH, spacing=spacing)
    every = round(max(spacing, PATCH.spacing) / spacing)
    for kind in (GroundKind.SLOPE_UP, GroundKind.FLAT):
        coarse, fine = ground_patch(kind, 5, patch=patch), ground_patch(kind, 5)
        common = fine[:: 2 if spacing == 0.1 else 1, :: 2 if spacing == 0.1 else 1]
        np.testing.assert_allclose(coarse[::every, ::every], common, atol=1e-6)
    stairs = ground_patch(GroundKind.STAIRS_UP, 9, patch=patch)
    assert np.ptp(stairs) == pytest.approx(1.2, rel=1e-6)
    # one cell, however wide it is
    assert np.diff(stairs[len(stairs) // 2]).max() == pytest.approx(0.15, rel=1e-5)


def test_levels_have_colors_that_can_be_told_apart():
    colors = level_colors()
    assert colors.shape == (LEVELS, 3)
    assert colors.min() >= 0.0
    assert colors.max() <= 1.0
    # the brightness rises: they differ without any hue
    assert np.diff(colors @ (0.2126, 0.7152, 0.0722)).min() > 0.0


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: ground_patch("swamp"), "ground_patch: kind must be one of flat, rough, .* got 'swamp'"),
        (lambda: ground_patch("stares_up"), "did you mean 'stairs_up'"),
        (lambda: ground_patch("flat", 10), "ground_patch: level must be from 0 to 9, got 10; give a level"),
        (lambda: ground_patch("flat", 0.5), "ground_patch: level must be a whole number"),  # type: ignore[arg-type]
        (lambda: ground_patch("flat", 0, -1), "ground_patch: seed must be zero or positive, got -1"),
        (lambda: GroundPatch(spacing=0.0), "GroundPatch: spacing must be .* got 0.0"),
        (
            lambda: GroundPatch(riser=LONE),
            r"GroundPatch: riser must be two sizes \[m\]: those of levels 0 and 9, got 0.1",
        ),
        (lambda: GroundPatch(riser=(0.1, -0.1)), "GroundPatch: riser.1. must be positive, got -0.1; give metres"),
        (
            lambda: GroundPatch(slope=(2.0, 25.0)),
            r"GroundPatch: slope\[0\] must be in \(0, 1.5708\), got 2.0; give radians",
        ),
        (lambda: GroundPatch(side=8.03), "GroundPatch: side must be an even number of cells of 0.05 m, got 8.03"),
        (lambda: GroundPatch(side=3.0), "GroundPatch: a tread must lie between .* side=3; make the side longer"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(call, message):
    with pytest.raises(ModelError, match=message) as told:
        call()
    assert "\n" not in str(told.value)
