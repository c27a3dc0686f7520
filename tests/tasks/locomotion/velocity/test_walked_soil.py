"""Robots on legs on soil: what carries them, energy, what is drawn for an episode, fresh ground at its start, bits."""

import math

import numpy as np
import pytest
import torch

from simwarp.core.interop import to_torch
from simwarp.scenes import QUADRUPED_FOOT_RADIUS
from simwarp.soil import PRESETS
from simwarp.tasks import InputError, make
from simwarp.tasks.locomotion.velocity import Ground, WalkedSoilConfig, WalkedSoilKind
from simwarp.tasks.locomotion.velocity.config import VelocityConfig
from simwarp.tasks.randomisation.soil_draws import RIGID_MODULUS, RIGID_SHARE

GRAVITY = 9.81


def walking(worlds, kind="sand", *, rough=False, spacing=0.01, pages=1024, **options):
    """The quadruped on soil, with the steps of its training."""
    soil = WalkedSoilConfig(kind=WalkedSoilKind(kind), rough=rough, spacing=spacing, pages=pages)
    usual = {"dt": 0.01, "decimation": 2, "push_speed": 0.0}
    return make("quadruped-velocity", worlds, ground="soil", soil=soil, **(usual | options))


def idle(task):
    return torch.zeros(task.num_worlds, task.action_size)


def acted(task, steps, seed=0):
    """Steps of random actions, which lie the same for a world of the same global index."""
    first = task.first_world
    generator = torch.Generator().manual_seed(seed)
    actions = 0.6 * (2.0 * torch.rand(steps, 8, task.action_size, generator=generator) - 1.0)
    for action in actions[:, first : first + task.num_worlds]:
        task.step(action)
    return task


def ball_load(depth, soil):
    """F = 2 pi ∫ k z(r)^n r dr of a foot's ball whose lowest point is this deep [N]; z(r) = d - R + sqrt(R² - r²)."""
    radius = QUADRUPED_FOOT_RADIUS
    edge = radius if depth >= radius else math.sqrt(radius**2 - (radius - depth) ** 2)
    r = np.linspace(0.0, edge, 4001)
    deep = np.maximum(depth - radius + np.sqrt(np.maximum(radius**2 - r * r, 0.0)), 0.0)
    return float(2.0 * math.pi * np.trapezoid(soil.k_phi * deep**soil.exponent * r, r))


# ---- what carries it ------------------------------------------------------------------------------------------------


def test_a_standing_robot_sinks_as_the_law_of_its_feet_says():
    """Gravity grows slowly, so that no foot presses the soil deeper than what it carries in the end does."""
    task = walking(1, "mid", spacing=0.003, pages=2048, start_angle=0.0)
    weight = GRAVITY * float(to_torch(task.simulation.model.body_mass)[0].sum())
    gravity = to_torch(task.simulation.model.gravity)
    for share in np.linspace(0.02, 1.0, 220):
        gravity[..., 2] = -GRAVITY * float(share)
        task.step(idle(task))
    depth = QUADRUPED_FOOT_RADIUS - task.on_feet.position()[0, :, 2].numpy()
    loads = task.on_feet.force[0, :, 2].numpy()
    assert loads.sum() == pytest.approx(weight, rel=0.03)  # it still sinks by 1 mm/s, and oscillates
    assert depth.min() > 0.01
    expected = np.array([ball_load(each, PRESETS["mid"]) for each in depth])
    # nodes of 3 mm across contacts of 4 cm: 1 % of area; feet slide by millimetres while legs yield, out of their pits
    assert expected.sum() == pytest.approx(loads.sum(), rel=0.04)
    assert expected == pytest.approx(loads, rel=0.08)


def test_softer_soil_lets_feet_sink_deeper():
    deepest = []
    for kind in ("soft", "sand", "hard"):
        task = walking(2, kind)
        for _ in range(50):
            task.step(idle(task))
        deepest.append(float(QUADRUPED_FOOT_RADIUS - task.on_feet.position()[:, :, 2].amin()))
        borne = []
        for _ in range(25):
            task.step(idle(task))
            borne.append(task.soil.forces.force[..., 2].sum(dim=1).mean())
        # calves stand in soft soil as well; the mean over half a second of what still sways
        assert float(torch.stack(borne).mean()) == pytest.approx(GRAVITY * 15.2, rel=0.03)
        assert task.on_feet.touching.all()
    assert deepest == sorted(deepest, reverse=True)
    assert deepest[0] > 0.1
    assert deepest[2] < 0.02


@pytest.mark.parametrize("kind", ["soft", "mid"])
def test_limp_legs_fold_and_gain_no_energy(kind):
    """Without drives, and with stops that give nothing back, only gravity works on the robot."""
    task = walking(2, kind, start_angle=0.0)
    for name in ("drive_stiffness", "drive_damping"):
        getattr(task.simulation.model, name).fill_(0.0)
    energy = [float(task.simulation.measure_energy().numpy()[0])]
    for _ in range(100):
        task.simulation.step(1)
        energy.append(float(task.simulation.measure_energy().numpy()[0]))
    fall = GRAVITY * 15.2 * 0.2
    assert energy[-1] < energy[0] - 0.5 * fall
    # what soil gives back is a predicted elastic force: 2 % of what falls, as of other shapes on soil
    assert np.diff(energy).max() < 0.02 * fall
    assert max(energy) <= energy[0] + 1e-3 * fall


def test_a_belly_on_soil_is_a_fall():
    task = walking(1, "mid", start_angle=0.0)
    for name in ("drive_stiffness", "drive_damping"):
        getattr(task.simulation.model, name).fill_(0.0)
    fell = False
    for _ in range(60):
        fell = fell or bool(task.step(idle(task)).terminated[0])
    assert fell


# ---- what is drawn --------------------------------------------------------------------------------------------------


def rows(task):
    """(W, 8) float64."""
    return task.soil.parameter[:, 0].double().numpy().copy()


def test_every_preset_is_a_choice():
    assert {kind.value for kind in WalkedSoilKind} == {"random", *PRESETS}


def test_a_named_soil_is_that_of_all_worlds():
    task = walking(2, "clay")
    task.restart()
    assert rows(task) == pytest.approx(np.tile(PRESETS["clay"].values(), (2, 1)), rel=1e-6)


def test_drawn_soils_are_between_sand_and_hard_or_nearly_rigid():
    task = walking(256, "random", pages=256, guard_steps=0)
    found = rows(task)
    rigid = found[:, 0] == RIGID_MODULUS
    # five standard deviations of 256 draws
    assert abs(rigid.mean() - RIGID_SHARE) < 5.0 * math.sqrt(RIGID_SHARE * (1.0 - RIGID_SHARE) / 256)
    for column, (sand, hard) in enumerate(zip(PRESETS["sand"].values(), PRESETS["hard"].values(), strict=True)):
        low, high = sorted((sand, hard))
        values = found[~rigid, column]
        assert ((values >= low * (1.0 - 1e-5)) & (values <= high * (1.0 + 1e-5))).all()  # float32, by logarithms
    assert len(np.unique(found[~rigid, 0])) > 150
    task.restart()
    assert (rows(task)[:, 4] != found[:, 4]).mean() > 0.5


def test_a_new_episode_has_fresh_soil_and_changes_no_other():
    task = acted(walking(3, "random"), 15)
    element = task.soil.element
    memory = {name: array.numpy().copy() for name, array in element.memory.items()}
    before, places = rows(task), task.on_feet.position()[:, :, :2].double().numpy()
    assert (element.height(places).numpy() < 0.0).any(axis=1).all()
    task.begin_episodes(torch.tensor([False, True, False]))
    after = {name: array.numpy() for name, array in element.memory.items()}
    assert after["count"][1] == 0
    assert (element.height(places).numpy()[1] == 0.0).all()
    assert (rows(task)[1] != before[1]).any()
    for name, values in after.items():
        assert (values[[0, 2]] == memory[name][[0, 2]]).all(), name


# ---- what is seen, bits ---------------------------------------------------------------------------------------------


def test_observations_are_those_of_rigid_ground():
    rigid, soft = make("quadruped-velocity", 1), walking(1)
    assert rigid.observation_names == soft.observation_names
    assert rigid.observation_shapes == soft.observation_shapes


def test_a_world_is_the_same_among_others_and_again():
    def state(task):
        return np.concatenate(
            [to_torch(getattr(task.simulation.state, name)).numpy().reshape(task.num_worlds, -1)
             for name in ("body_x", "body_rot", "body_v", "body_omega")], axis=1
        )  # fmt: skip

    among = acted(walking(3, "random", seed=5), 30)
    again = acted(walking(3, "random", seed=5), 30)
    alone = acted(walking(1, "random", seed=5, first_world=2), 30)
    np.testing.assert_array_equal(state(among), state(again))
    np.testing.assert_array_equal(state(among)[2:], state(alone))
    assert (state(among)[0] != state(among)[2]).any()


def test_soil_lies_on_rough_ground():
    task = acted(walking(8, "mid", rough=True), 40)
    feet = task.on_feet.position()
    ground = task.ground.height(feet[:, :, :2].contiguous())
    sunk = ground - (feet[:, :, 2] - QUADRUPED_FOOT_RADIUS)
    assert (sunk.amax(dim=1) > 0.0).all()
    assert (sunk < 0.15).all()


def test_bad_grids_are_refused_in_one_line():
    with pytest.raises(Exception, match="spacing must be positive and at most half the narrowest shape's width"):
        walking(1, spacing=0.05)
    with pytest.raises(InputError, match="pages"):
        WalkedSoilConfig(pages=3)
    assert VelocityConfig(ground=Ground.SOIL).on_soil
