"""Balls in the arcs of sprockets and in grooves, against a reference that looks at every arc."""

import dataclasses

import numpy as np
import pytest

from simwarp.core.types import ShapeType
from simwarp.geometry.sprocket_profiles import SprocketProfile, add_profile_assets
from tests.reference.collision import Solid
from tests.reference.sprockets import Profile, Touch, ball_in_groove, ball_in_sprocket
from tests.unit.kernels.collision.collision_pairs import Batch, Contacts, random_rotation

SINGLE = Profile(center=0.3, arc=0.089, tip=0.2605, teeth=10, half_width=0.1)
DOUBLE = Profile(center=np.hypot(0.2371, 0.0464), arc=0.0223, tip=0.2715, teeth=10, half_width=0.1,
                 offset=np.arctan2(0.0464, 0.2371))  # fmt: skip
ODD = Profile(center=1.0, arc=0.5, tip=0.9, teeth=5, half_width=0.2)
PROFILES = (SINGLE, DOUBLE, ODD)
NEAR = 1e-5
"""Of an edge of the rule [m]: there float32 may decide otherwise."""


def sphere(p, radius, margin=0.0):
    return Solid(ShapeType.SPHERE, np.asarray(p, float), np.eye(3), np.full(3, radius), margin)


def wheel(kind, x, rot, radius, half_width, asset=-1, margin=0.0):
    return Solid(kind, np.asarray(x, float), rot, np.array([radius, half_width, radius]), margin, asset=asset)


def collided(pairs, reach=1e6) -> list[Contacts]:
    batch = Batch(pairs, reach)
    shapes = [SprocketProfile(p.teeth, p.center / p.tip, p.arc / p.tip, p.offset) for p in PROFILES]
    add_profile_assets(batch.assets, shapes, "cpu")
    batch.launch()
    return batch.results()


def is_decided(profile: Profile, p, radius: float) -> bool:
    """The rule says the same of all points near this one."""
    told = {
        (touch is None, touch and touch.feature)
        for shift in NEAR * np.vstack([np.zeros(3), np.eye(3), -np.eye(3)])
        for touch in [ball_in_sprocket(profile, p + shift, radius)]
    }
    return len(told) == 1


def check(found: Contacts, touch, rot, x, size: float) -> None:
    assert len(found) == (touch is not None)
    if touch is not None:
        np.testing.assert_allclose(found.gap, [touch.gap], atol=2e-6 * size)
        # of float32 positions of the order of the size, seen from a centre that is `size` / 50 away at least
        np.testing.assert_allclose(found.normal[0], rot @ touch.normal, atol=5e-5)
        np.testing.assert_allclose(found.point[0], x + rot @ touch.point, atol=5e-6 * size)
        assert found.feature[0] == touch.feature


@pytest.mark.parametrize("number", range(len(PROFILES)))
def test_a_sprocket_as_its_rule_says(number):
    rng, profile = np.random.default_rng(number), PROFILES[number]
    pairs: list[tuple[Solid, Solid]] = []
    wanted: list[tuple[Touch | None, np.ndarray, np.ndarray]] = []
    while len(pairs) < 400:
        at = rng.uniform(-1.05, 1.05, 3) * (profile.center, profile.center, profile.half_width)
        if len(pairs) % 8:  # anywhere, or about an arc: behind one there is no contact
            _, arc = profile.centers()[rng.integers(len(profile.centers()))]
            at[:2] = arc + rng.uniform(-0.9, 0.9, 2) * profile.arc
        radius = rng.uniform(0.1, 0.9) * profile.arc
        centres = [np.linalg.norm(at[:2] - c) for _, c in profile.centers()]
        if is_decided(profile, at, radius) and min(centres) > 0.02 * profile.center:
            rot, x = random_rotation(rng), rng.normal(size=3) * profile.tip
            toothed = wheel(ShapeType.SPROCKET, x, rot, profile.tip, profile.half_width, number)
            pairs.append((sphere(x + rot @ at, radius), toothed))
            wanted.append((ball_in_sprocket(profile, at, radius), rot, x))
    found = collided(pairs)
    assert 0.2 < np.mean([len(each) for each in found]) < 0.9
    for contacts, (touch, rot, x) in zip(found, wanted, strict=True):
        check(contacts, touch, rot, x, profile.center)
    # the other way round: from the sprocket's side
    for contacts, mirrored in zip(found, collided([(b, a) for a, b in pairs]), strict=True):
        assert len(contacts) == len(mirrored)
        if len(contacts):
            np.testing.assert_array_equal(mirrored.normal, -contacts.normal)
            np.testing.assert_array_equal(mirrored.gap, contacts.gap)
            apart = mirrored.point - contacts.point
            np.testing.assert_allclose(apart, contacts.gap[:, None] * contacts.normal, atol=1e-6 * profile.center)


def test_a_groove_as_its_rule_says():
    rng = np.random.default_rng(5)
    pairs, wanted = [], []
    for _ in range(300):
        at, rot, x = rng.uniform(-1.1, 1.1, 3) * (0.3, 0.3, 0.05), random_rotation(rng), rng.normal(size=3)
        if abs(np.hypot(at[0], at[1]) - 0.3) > NEAR and abs(at[2]) > NEAR:
            pairs.append((sphere(x + rot @ at, 0.006), wheel(ShapeType.GROOVE, x, rot, 0.3, 0.0255)))
            wanted.append((ball_in_groove(0.3, 0.0255, at, 0.006), rot, x))
    for contacts, (touch, rot, x) in zip(collided(pairs), wanted, strict=True):
        check(contacts, touch, rot, x, 1.0)


def test_only_what_comes_within_reach():
    deep, away = sphere((0.22, 0.0, 0.0), 0.015), sphere((0.24, 0.0, 0.0), 0.015)
    sprocket = wheel(ShapeType.SPROCKET, (0.0, 0.0, 0.0), np.eye(3), 0.2605, 0.1, 0)
    assert [len(each) for each in collided([(deep, sprocket), (away, sprocket)], 0.005)] == [1, 0]
    groove = wheel(ShapeType.GROOVE, (0.0, 0.0, 0.0), np.eye(3), 0.3, 0.02)
    sides = [sphere((0.1, 0.0, z), 0.006) for z in (0.012, 0.0, -0.02)]
    assert [len(each) for each in collided([(side, groove) for side in sides], 0.005)] == [1, 0, 1]


def test_margins_narrow_the_room():
    sprocket = wheel(ShapeType.SPROCKET, (0.0, 0.0, 0.0), np.eye(3), 0.2605, 0.1, 0, margin=0.002)
    groove = wheel(ShapeType.GROOVE, (0.0, 0.0, 0.0), np.eye(3), 0.3, 0.02, margin=0.002)
    on_arc, in_groove = collided([
        (sphere((0.23, 0.0, 0.0), 0.015, 0.001), sprocket), (sphere((0.1, 0.0, 0.01), 0.006, 0.001), groove),
    ])  # fmt: skip
    np.testing.assert_allclose(on_arc.gap, [0.089 - 0.3 + 0.23 - 0.015 - 0.003], atol=1e-6)
    np.testing.assert_allclose(in_groove.gap, [0.02 - 0.01 - 0.006 - 0.003], atol=1e-6)


def test_a_ball_at_the_centre_of_an_arc_or_of_the_sprocket_is_safe():
    sprocket = wheel(ShapeType.SPROCKET, (0.0, 0.0, 0.0), np.eye(3), 0.2605, 0.1, 0)
    bottomless = dataclasses.replace(sprocket, asset=2, size=np.array([0.9, 0.2, 0.9]))
    middle, axis, deep = collided([
        (sphere((np.float32(0.3) * 0.99999994, 0.0, 0.0), 0.015), sprocket), (sphere((0.0, 0.0, 0.0), 0.015), sprocket),
        (sphere((1e-20, -1e-30, 0.0), 0.1), bottomless),
    ])  # fmt: skip
    for contacts in (middle, axis, deep):
        assert np.isfinite(np.append(contacts.gap, contacts.normal)).all()
        np.testing.assert_allclose(np.linalg.norm(contacts.normal, axis=1), 1.0, atol=1e-6)
    assert len(axis) == 0, "it is behind all arcs"


def test_each_arc_has_its_own_feature():
    for number, profile in ((0, SINGLE), (1, DOUBLE)):
        numbers, places = zip(*profile.centers(), strict=True)
        sprocket = wheel(ShapeType.SPROCKET, (0.0, 0.0, 0.0), np.eye(3), profile.tip, 0.1, number)
        balls = [sphere([*(c * (1.0 - 0.5 * profile.arc / profile.center)), 0.0], 0.01) for c in places]
        found = collided([(ball, sprocket) for ball in balls])
        assert [int(each.feature[0]) for each in found] == list(numbers)
        assert len(set(numbers)) == len(numbers)
