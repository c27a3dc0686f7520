"""Conditions of driving: what each does, that neutral ones do nothing, how they are drawn, and what is refused."""

import dataclasses
import math

import numpy as np
import pytest
import torch

from simwarp.core.interop import to_torch
from simwarp.sensors import Lighting
from simwarp.tasks import InputError, TaskConfig
from simwarp.tasks.driving.conditions import NEUTRAL, NOMINAL_SHARE, RANDOM_RANGES, Conditions, ConditionsConfig
from simwarp.tasks.randomisation.randomisation_config import Range, Sensing
from simwarp.vehicle.spec.vehicle_spec import SpecError
from tests.reference.image_noise import disturbed, image_key, reddened
from tests.tasks.driving.driving_checks import NAMES, SMALL, copied, driving, held, random_actions

LEVELS = 1.5
"""Of 255: the image without a condition is rounded by half a level, that with it too, and slopes are at most 2."""
GAMMA = 2.2


def road(worlds=1, **options):
    return driving("obstacle-avoidance", worlds, **{**SMALL, **options})


def image(task):
    """(W, height, width, 3) float64, 0 to 1."""
    return task.observe()["camera"].double().numpy() / 255.0


def road_pixels(task):
    """(height, width) bool of the pixels that see the road in front of the first pillar, and their distances [m].

    From the pose of the camera, by a plane: nothing of the renderer. The hood is told by its colour.
    """
    config = task.config
    rotation = to_torch(task.simulation.state.body_rot)[0, task.parts.chassis].double().numpy()
    x, w = rotation[:3], rotation[3]
    cross = np.array([[0, -x[2], x[1]], [x[2], 0, -x[0]], [-x[1], x[0], 0]])
    turn = np.eye(3) + 2.0 * w * cross + 2.0 * cross @ cross
    place = to_torch(task.simulation.state.body_x)[0, task.parts.chassis].numpy() + turn @ (
        np.asarray(task.camera_place) + task.parts.reference
    )
    wide, high = config.camera_width, config.camera_height
    slope = math.tan(0.5 * config.camera_fov)
    column, row = np.meshgrid((np.arange(wide) + 0.5) * 2.0 / wide - 1.0, (high - 2.0 * (np.arange(high) + 0.5)) / wide)
    rays = np.stack([np.ones_like(column), -slope * column, slope * row], axis=-1)
    rays = (rays / np.linalg.norm(rays, axis=-1, keepdims=True)) @ turn.T
    with np.errstate(divide="ignore"):
        distance = -place[2] / rays[..., 2]
    hit = place + distance[..., None] * rays
    seen = (distance > 0.0) & (hit[..., 0] < 20.0) & (np.abs(hit[..., 1]) < 7.0)
    clear = image(road())[0]
    seen &= np.abs(clear - np.median(clear[seen], axis=0)).max(axis=-1) < 2.0 / 255.0
    assert seen.sum() > 100
    return seen, distance[seen]


# ---- nothing, and ranges -----------------------------------------------------------------------------------------


def test_every_condition_has_a_range_and_a_neutral_value():
    fields = {each.name for each in dataclasses.fields(ConditionsConfig)} - {
        each.name for each in dataclasses.fields(TaskConfig)
    }
    assert set(RANDOM_RANGES) - {"action_delay"} == fields - {"conditions", "tires"}
    assert {*NEUTRAL, "friction"} == set(RANDOM_RANGES)


@pytest.mark.quick("obstacle-avoidance")
@pytest.mark.parametrize("name", NAMES)
def test_neutral_conditions_leave_every_bit(name):
    """Given by hand as ranges of one value, which go the way of those that are drawn."""
    same = {
        key: (value, value)
        for key, value in {**NEUTRAL, "friction": 0.9}.items()
        if isinstance(value, int | float) and key != "action_delay"
    }
    plain, neutral = driving(name, 2, **SMALL), driving(name, 2, **SMALL, **same)
    assert neutral.conditions.values.keys() >= {"light", "fog", "image_noise", "contrast"}
    for action in random_actions(plain, 4):
        one, other = plain.step(action), neutral.step(action)
        for group, values in one.observations.items():
            assert torch.equal(values, other.observations[group])
        assert torch.equal(one.rewards, other.rewards)


def test_random_draws_what_is_left_at_its_default_and_nothing_else():
    config = road().config_type(conditions=Conditions.RANDOM, fog=0.01, contrast=(1.0, 1.0), light=(0.5, 2.0))
    spans = {name: config.span(name) for name in RANDOM_RANGES}
    own = {"fog": (0.01, 0.01), "contrast": (1.0, 1.0), "light": (0.5, 2.0)}
    assert spans == {**RANDOM_RANGES, **own}
    by_hand = road().config_type(
        conditions="random", randomise={"body_mass": Range(1.0, 2.0)}, sensing={"camera": Sensing(delay=(2, 2))}
    )
    assert by_hand.span("mass") is None
    assert by_hand.span("image_delay") is None
    assert by_hand.uncertainty.sensing["camera"].delay == (2, 2)
    plain = road().config_type()
    assert [name for name in RANDOM_RANGES if plain.span(name) is not None] == ["friction"]


def test_draws_fill_their_ranges_and_differ_by_world_and_episode():
    task = road(160, conditions="random", max_episode_steps=1)
    before = {name: values.clone() for name, values in task.conditions.values.items()}
    assert before.keys() == {name for name in RANDOM_RANGES if name not in ("mass", "image_delay", "action_delay")}
    nominal = before["fog"] == 0.0
    task.step(held(task))
    drawn = task.conditions.values["fog"] != 0.0
    count = int(drawn.sum())
    for name, whole in task.conditions.values.items():
        low, high = RANDOM_RANGES[name]
        values = whole[drawn]
        assert low <= values.min()
        assert values.max() <= high + 1e-6 * abs(high)  # float32
        # the mean of uniform draws is within 4 standard deviations, span / sqrt(12 * count) each
        assert abs(values.mean() - 0.5 * (low + high)) < 4.0 * (high - low) / math.sqrt(12 * count)
        assert len(values.unique()) == count
        assert (values != before[name][drawn]).all()
        assert len(whole[~drawn].unique()) == 1  # what is nominal is the same in all such worlds
    both = torch.stack([values[drawn] for values in task.conditions.values.values()])
    # of 21 pairs of independent draws none correlates by more than 4 / sqrt(count)
    assert (both.corrcoef() - torch.eye(len(both))).abs().max() < 4.0 / math.sqrt(count)
    # a fifth of the episodes is nominal, within 4 standard deviations, and not always the same ones
    deviation = math.sqrt(160 * NOMINAL_SHARE * (1.0 - NOMINAL_SHARE))
    assert abs(int(nominal.sum()) - 160 * NOMINAL_SHARE) < 4.0 * deviation
    assert not torch.equal(nominal, ~drawn)


def test_nominal_episodes_among_drawn_ones_look_and_grip_as_a_nominal_task():
    drawn, plain = road(24, conditions="random"), road(24, obs="camera")
    nominal = drawn.conditions.values["fog"] == 0.0
    assert 0 < int(nominal.sum()) < 24
    assert torch.equal(drawn.conditions.values["friction"][nominal], torch.full((int(nominal.sum()),), 0.9))
    # the same worlds; with another load the vehicle stands a few centimetres lower, which shifts edges by a pixel
    images = [task.observe()["camera"].float().mean(dim=(1, 2)) for task in (drawn, plain)]
    difference = (images[0] - images[1]).abs().amax(dim=1)
    assert difference[nominal].max() < 2.0
    assert difference[~nominal].median() > 10.0


def test_an_episode_that_begins_changes_the_conditions_of_its_world_alone():
    task = road(3, conditions="random")
    for action in random_actions(task, 2):
        task.step(action)
    before, seen = {name: values.clone() for name, values in task.conditions.values.items()}, copied(task.observe())
    masses = to_torch(task.simulation.model.body_mass).clone()
    task.begin_episodes(torch.tensor([False, True, False]))
    after = task.observe()["camera"]
    for name, values in task.conditions.values.items():
        assert (values == before[name]).tolist() == [True, False, True]
    assert [bool((after[world] == seen["camera"][world]).all()) for world in range(3)] == [True, False, True]
    assert ((to_torch(task.simulation.model.body_mass) == masses).all(dim=1)).tolist() == [True, False, True]


# ---- what each does ----------------------------------------------------------------------------------------------


def test_friction_is_that_of_the_ground_and_lets_wheels_slide():
    fixed = driving("obstacle-avoidance", 2, friction=0.25)
    assert to_torch(fixed.vehicle.tires.ground_friction).tolist() == [0.25, 0.25]
    drawn = driving("obstacle-avoidance", 8, friction=(0.2, 1.0))
    friction = to_torch(drawn.vehicle.tires.ground_friction)
    assert torch.equal(friction, drawn.conditions.values["friction"])
    ice, road = driving("obstacle-avoidance", 1, friction=0.08), driving("obstacle-avoidance", 1)
    for task in (ice, road):
        for _ in range(30):
            task.step(held(task, 0.0, 1.0))
    # Coulomb: friction times weight pushes at most, but for what tires grip better below the 17 kN of their curves
    most = 1.25 * 0.08 * 9.81 * 30 * ice.config.control_dt
    assert ice.motion()[0, 0] < most < road.motion()[0, 0]


def test_mass_is_that_of_the_chassis_with_its_inertia_and_vehicles_start_settled():
    plain, heavy = driving("obstacle-avoidance", 1), driving("obstacle-avoidance", 1, mass=1.5)
    model, other, body = plain.simulation.model, heavy.simulation.model, plain.parts.chassis
    factor = (to_torch(other.body_mass) / to_torch(model.body_mass))[0]
    assert factor[body].item() == pytest.approx(1.5, rel=1e-6)
    assert factor.tolist() == pytest.approx([1.5 if k == body else 1.0 for k in range(len(factor))], rel=1e-6)
    inertia = to_torch(other.body_inertia_b)[0, body] / to_torch(model.body_inertia_b)[0, body]
    assert inertia.diagonal().tolist() == pytest.approx([1.5] * 3, rel=1e-5)
    height = [float(to_torch(task.simulation.state.body_x)[0, body, 2]) for task in (plain, heavy)]
    sunk = height[0] - height[1]
    assert sunk > 0.01
    heavy.step(held(heavy, 0.0, -1.0))
    # at rest from the start, but for what is left to settle after SETTLING seconds
    assert abs(float(to_torch(heavy.simulation.state.body_x)[0, body, 2]) - height[1]) < 0.1 * sunk
    platoon = driving("convoy", 1, leaders="simulated", leading=1, followers=2, mass=(1.2, 1.4))
    mass = to_torch(platoon.simulation.model.body_mass)[0]
    chassis = [platoon.simulation.model.body(f"v{index}_chassis") for index in range(3)]
    assert ((mass[chassis] > 1.19 * 2086.0) & (mass[chassis] < 1.41 * 2087.0)).all()


def test_fog_leaves_its_share_of_each_distance():
    density = 0.06
    clear, foggy = road(), road(fog=density)
    seen, distance = road_pixels(clear)
    left = np.exp(-density * distance)[:, None]
    light = image(clear)[0][seen] ** GAMMA
    expected = (left * light + (1.0 - left) * np.array(Lighting().horizon)) ** (1.0 / GAMMA)
    assert np.abs(image(foggy)[0][seen] - expected).max() < LEVELS / 255.0
    assert np.abs(expected - image(clear)[0][seen]).max() > 20.0 / 255.0


@pytest.mark.parametrize("factor", [0.3, 1.4])
def test_light_is_a_factor_before_the_response(factor):
    plain, lit = image(road())[0], image(road(light=factor))[0]
    expected = np.minimum(factor ** (1.0 / GAMMA) * plain, 1.0)
    unsaturated = plain < 254.5 / 255.0
    assert np.abs(lit - expected)[unsaturated].max() < LEVELS / 255.0


def test_a_lower_sun_lights_the_road_less_and_redder():
    elevation, built = math.radians(12.0), math.atan2(1.0, 0.5)
    task, light = road(sun_elevation=elevation), Lighting()
    seen, _ = road_pixels(task)
    sun = reddened(np.array(light.suns[0].color), elevation, built)
    expected = (0.3 * (np.array(light.ambient) + math.sin(elevation) * sun)) ** (1.0 / GAMMA)
    # no shadow lies on most of the road, and the hood's none either
    found = np.median(image(task)[0][seen], axis=0)
    assert found == pytest.approx(expected, abs=LEVELS / 255.0)
    direction = to_torch(task.camera.lights.sun_direction)[0, 0]
    assert math.atan2(direction[1], direction[0]) == pytest.approx(math.atan2(-0.3, 0.4), abs=1e-6)


def test_the_sun_stands_where_its_azimuth_says():
    task = road(2, sun_azimuth=(-math.pi, math.pi))
    direction = to_torch(task.camera.lights.sun_direction)[:, 0]
    azimuth = task.conditions.values["sun_azimuth"]
    level = torch.stack([azimuth.cos(), azimuth.sin()], dim=1) * direction[:, :2].norm(dim=1, keepdim=True)
    assert torch.allclose(direction[:, :2], level, atol=1e-6)
    assert torch.allclose(direction.norm(dim=1), torch.ones(2), atol=1e-6)
    assert torch.allclose(to_torch(task.camera.lights.sun_color)[:, 0], torch.tensor(Lighting().suns[0].color))
    behind, ahead = (image(road(sun_azimuth=angle))[0] for angle in (math.pi, 0.0))
    blue = behind[..., 2] > behind[..., 0] + 0.3  # the pillars, whose faces look back
    assert blue.sum() > 20
    assert behind[blue].mean() > 1.2 * ahead[blue].mean()


def test_noise_and_contrast_are_those_of_the_reference_number_by_number():
    task = road(2, seed=11, first_world=5, image_noise=0.08, contrast=0.7)
    plain = road(2, seed=11, first_world=5)
    for action in random_actions(task, 2):
        task.step(action)
        plain.step(action)
    for world in range(2):
        key = image_key(11, 5 + world, 0, 2)
        expected = disturbed(plain.observe()["camera"][world].numpy(), 0.7, 0.08, key)
        found = task.observe()["camera"][world].numpy()
        # rounded to whole levels; float32 with a fast logarithm is off by less than 0.01 levels
        assert np.abs(found - expected).max() <= 0.51


def test_noise_has_its_deviation_and_is_another_one_in_every_step_world_and_channel():
    sigma = 0.05
    task, plain = road(4, image_noise=sigma, camera_width=160, camera_height=90), road(4)
    action = held(task, 0.0, -1.0)
    kept = []
    for _ in range(2):
        task.step(action)
        noise = (image(task) - to_torch(task.camera.data).double().numpy() / 255.0)[..., 60:, :, :]
        kept.append(noise)
    stack = np.stack(kept)  # (steps, W, rows, columns, channels) of the road and the hood: far from black and white
    count = stack.size
    quantised = math.sqrt(sigma**2 + (1.0 / 255.0) ** 2 / 12.0)
    assert stack.std() == pytest.approx(quantised, rel=5.0 / math.sqrt(2.0 * count))
    assert abs(stack.mean()) < 5.0 * sigma / math.sqrt(count)
    parts = stack.transpose(0, 1, 4, 2, 3).reshape(2 * 4 * 3, -1)
    apart = np.corrcoef(parts) - np.eye(len(parts))
    assert np.abs(apart).max() < 5.0 / math.sqrt(parts.shape[1])
    assert plain.images.read().data_ptr() == to_torch(plain.camera.data).data_ptr()


def test_an_image_is_made_once_in_a_step_but_where_an_episode_begins():
    task = road(3, image_noise=0.05)
    task.step(held(task, 0.0, 0.5))
    task.images.read().fill_(7)
    task.conditions.draw(torch.tensor([False, True, False]))
    seen = task.images.read()
    assert (seen[[0, 2]] == 7).all()
    assert not (seen[1] == 7).all()


def test_a_late_image_is_that_of_steps_before():
    delay, steps = 2, 6
    task, plain = road(2, image_delay=delay), road(2)
    actions, seen, late = random_actions(plain, steps), [plain.observe()["camera"].clone()], []
    for action in actions:
        seen.append(plain.step(action).observations["camera"].clone())
        result = task.step(action)
        late.append(result.observations["camera"].clone())
    for step, found in enumerate(late, start=1):
        assert torch.equal(found, seen[max(0, step - delay)])
    assert torch.equal(task.motion(), plain.motion())


def test_tires_are_those_of_the_name():
    spec = driving("obstacle-avoidance", 1, tires="pacejka89").spec
    assert {axle.tire.template for axle in spec.axles} == {"pacejka89"}
    assert driving("obstacle-avoidance", 1).spec.axles[0].tire.template != "pacejka89"


# ---- mistakes ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"fog": -0.1}, "fog must be zero or positive, got -0.1"),
        ({"fog": (0.2, 0.1)}, r"fog must be one number, or two in order, least and largest, got \(0.2, 0.1\)"),
        ({"sun_elevation": 0.0}, "sun-elevation must be"),
        ({"sun_elevation": 60.0}, "sun-elevation must be"),
        ({"image_noise": 2.0}, "image-noise must be"),
        ({"image_delay": 0.5}, "image-delay must be"),
        ({"conditions": "some"}, "conditions must be"),
        ({"mass": 2.0, "randomise": {"body_mass": Range(1.0, 2.0)}}, "mass must be 1 where randomise has"),
        ({"image_delay": 1, "sensing": {"camera": Sensing(delay=(1, 1))}}, "image-delay must be 0 where sensing"),
        ({"tires": "tmeasy", "soil": "soft"}, "tires must be None on soil"),
    ],
)
def test_a_mistake_is_named_in_a_line(options, message):
    with pytest.raises(InputError, match=message) as caught:
        driving("obstacle-avoidance", 1, **options)
    assert "\n" not in str(caught.value)


def test_what_a_task_does_not_have_is_refused():
    with pytest.raises(InputError, match="sun-azimuth: there is no sun in this task's light"):
        driving("hallway", 1, **SMALL, sun_azimuth=0.5)
    with pytest.raises(SpecError, match="unknown tire 'pacejka'"):
        driving("obstacle-avoidance", 1, tires="pacejka")
    inside = driving("hallway", 1, **SMALL, conditions="random")
    assert not {"sun_elevation", "sun_azimuth"} & inside.conditions.values.keys()
    without = driving("hallway", 1, conditions="random")
    assert without.conditions.values.keys() == {"friction"}


def test_on_soil_all_but_friction_and_tires_is_drawn():
    task = driving("off-road", 2, **SMALL, soil="random", obstacles=0, conditions="random", max_episode_steps=2)
    assert "friction" not in task.conditions.values
    assert {"fog", "light"} <= task.conditions.values.keys()
    for action in random_actions(task, 3):
        assert torch.isfinite(task.step(action).rewards).all()
