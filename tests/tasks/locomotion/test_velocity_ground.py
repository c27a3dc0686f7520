"""Ground of walking robots: heights of the triangles that feet meet, scans, levels that follow what robots achieve."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch

import simwarp as sw
from simwarp.core.interop import to_torch
from simwarp.core.types import ShapeType
from simwarp.scenery import LEVELS, GroundKind, GroundPatch, ground_patch, height_at, level_colors
from simwarp.sensors import Visuals
from simwarp.tasks import InputError
from simwarp.tasks.framework.config_values import config_from_plain, config_to_plain
from simwarp.tasks.locomotion.velocity.ground import Climbing, Ground, RoughConfig, RoughGround, ground_of
from simwarp.tasks.locomotion.velocity.height_scan import RayScan, ScanConfig
from simwarp.viewer.live.batches import Batches
from tests.reference.levels import Climber
from tests.tasks.locomotion.rolling_task import RADIUS, Rolling, rolling

SIDE = GroundPatch().side
EVERY = RoughConfig(kinds=tuple(GroundKind))


def idle(task: Rolling) -> torch.Tensor:
    return torch.zeros(task.num_worlds, 2)


def patch_of(task: Rolling, world: int) -> np.ndarray:
    """The heights that a world shows, made anew from its state."""
    ground, config = task.ground, task.config.rough
    kind, level = config.kinds[int(ground.kind[world])], int(ground.level[world])
    variant = int(ground.extra_state()["ground_variant"][world])
    return ground_patch(kind, level, (config.seed * config.variants + variant) * LEVELS + level)


def put(task: Rolling, x: torch.Tensor, y: torch.Tensor, z: torch.Tensor | float) -> None:
    """Balls at places, at rest."""
    place = to_torch(task.simulation.state.body_x)
    place[:, task.ball, 0], place[:, task.ball, 1], place[:, task.ball, 2] = x.double(), y.double(), z
    to_torch(task.simulation.state.body_v).zero_()
    to_torch(task.simulation.state.body_omega).zero_()


def finish(task: Rolling, walked: float, asked: float) -> None:
    """End an episode in which so much was walked, up to the rim, and so much commanded [m]."""
    state = task.ground.extra_state()
    for name, value in (("walked", walked), ("asked", asked), ("expected", asked), ("farthest", 3.4)):
        state[f"ground_{name}"].fill_(value)
    task.ground.choose(torch.ones(task.num_worlds, dtype=torch.bool, device=task.device))


# ---- heights -----------------------------------------------------------------------------------------------------


def test_heights_are_those_of_the_patch_that_a_world_shows():
    task = rolling(40, rough=EVERY)
    points = torch.rand(40, 200, 2, generator=torch.Generator().manual_seed(0)) * 9.0 - 4.5  # beyond the border too
    found = task.ground.height(points.to(task.device)).numpy()
    for world in range(40):
        wanted = height_at(patch_of(task, world), (SIDE, SIDE), points[world].double().numpy())
        # places are rounded to 1e-5 cells; a cell may rise by 0.6 m
        np.testing.assert_allclose(found[world], wanted, atol=1e-5)
    assert len({(int(kind), int(level)) for kind, level in zip(task.ground.kind, task.ground.level, strict=True)}) > 25


def test_a_ball_rests_on_the_height_that_is_told():
    stairs = RoughConfig(kinds=(GroundKind.STAIRS_UP, GroundKind.STAIRS_DOWN), level=9)
    task = rolling(6, rough=stairs)
    # in the middle of the treads, which begin 1.05 m from the middle and are 0.25 m deep
    x = torch.tensor([0.0, 1.175, -1.475, 2.675, -3.4, 1.775], device=task.device)
    y = 0.3 * torch.ones(6, device=task.device)
    under = task.ground.height(torch.stack([x, y], dim=1)[:, None])[:, 0]
    assert len(under.unique()) >= 5
    put(task, x, y, under.double() + RADIUS + 0.002)
    for _ in range(30):
        task.step(idle(task))
    places = task.views.body_q[:, task.ball, :3]
    # contact is held to the solver's tolerance, far below a tenth of a millimetre
    np.testing.assert_allclose(places[:, 2].numpy(), (under + RADIUS).numpy(), atol=1e-4)
    assert float((places[:, 0] - x).abs().max()) < 0.01


def test_a_level_patch_is_as_good_as_a_plane():
    flat = dataclasses.replace(EVERY, kinds=(GroundKind.FLAT,))
    tasks = [rolling(3, ground=ground, rough=flat) for ground in Ground]
    angle = torch.tensor([0.0, 0.5, 2.3])
    action = 0.3 * torch.stack([angle.cos(), angle.sin()], dim=1)
    for _ in range(35):  # about a metre and a half, over some thirty edges between triangles
        ends = [task.step(action).observations["policy"] for task in tasks]
    places = [task.views.body_q[:, task.ball, :3] for task in tasks]
    assert float(places[0][:, :2].norm(dim=1).min()) > 0.5
    # the same law on another surface: contact solves to 1e-4 m/s, over 0.7 s
    np.testing.assert_allclose(places[0].numpy(), places[1].numpy(), atol=1e-4)
    np.testing.assert_allclose(ends[0].numpy(), ends[1].numpy(), atol=1e-4)


# ---- scan --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", Ground)
def test_a_scan_is_the_ground_below_the_grid_over_the_feet(kind):
    scan = ScanConfig(ahead=11, across=7, spacing=0.12, limit=0.3)
    task = rolling(20, ground=kind, rough=EVERY, scan=scan)
    draws = torch.Generator().manual_seed(3)
    position = torch.cat([torch.rand(20, 2, generator=draws) * 6.0 - 3.0, torch.rand(20, 1, generator=draws)], dim=1)
    yaw = torch.rand(20, generator=draws) * 6.2 - 3.1
    found = task.ground.scan(position.to(task.device), yaw.to(task.device)).numpy()
    assert found.shape == (20, 77)
    for world in range(20):
        heading = float(yaw[world])
        wanted = []
        for ahead in range(-5, 6):
            for left in range(-3, 4):
                x = position[world, 0] + 0.12 * (ahead * np.cos(heading) - left * np.sin(heading))
                y = position[world, 1] + 0.12 * (ahead * np.sin(heading) + left * np.cos(heading))
                below = 0.0
                if kind is Ground.ROUGH:
                    below = float(height_at(patch_of(task, world), (SIDE, SIDE), [(float(x), float(y))])[0])
                wanted.append(np.clip(below - (float(position[world, 2]) - RADIUS), -0.3, 0.3))
        # the same, and the grid is turned in float32
        np.testing.assert_allclose(found[world], wanted, atol=2e-5)
    assert len(scan.names()) == 77
    assert scan.names()[0] == "ground -0.60 ahead -0.36 left"


def test_rays_see_what_is_looked_up():
    task = rolling(30, rough=EVERY)
    assert task.builder is not None
    visuals = Visuals(task.builder)
    visuals.hide(*(index for index, shape in enumerate(task.builder.shapes) if shape.name == "ball"))
    rays = RayScan(visuals.finalize(task.simulation.model), task.simulation, task.config.scan, RADIUS)
    draws = torch.Generator().manual_seed(5)
    for _ in range(3):
        yaw = (torch.rand(30, generator=draws) * 6.2 - 3.1).to(task.device)
        flat = (torch.rand(30, 2, generator=draws) * 6.0 - 3.0).to(task.device)
        height = task.ground.height(flat[:, None])[:, 0] + RADIUS
        position = torch.cat([flat, height[:, None]], dim=1)
        looked, seen = task.ground.scan(position, yaw), rays(position, yaw)
        # a ray's place is rounded to float32 about the scene's origin, 1e-6 m at most; facets rise by 12 times that
        np.testing.assert_allclose(seen.numpy(), looked.numpy(), atol=3e-5)
        assert float(looked.abs().max()) > 0.1


def test_rays_also_see_boxes_and_no_roofs():
    builder = sw.ModelBuilder()
    builder.add_shape_plane(name="ground")
    builder.add_shape_box(sw.WORLD, half=(0.2, 1.0, 0.1), pose=sw.pose((1.0, 0.0, 0.1)), name="beam")
    builder.add_shape_box(sw.WORLD, half=(3.0, 3.0, 0.1), pose=sw.pose((0.0, 0.0, 2.0)), name="roof")
    builder.add_body("base", mass=1.0, inertia=(1.0, 1.0, 1.0), pose=sw.pose((0.0, 0.0, 0.3)))
    simulation = sw.Simulation(builder.finalize(2, "cpu"), 0.01)
    scan = ScanConfig(ahead=3, across=1, spacing=1.0, limit=0.4)
    rays = RayScan(Visuals(builder).finalize(simulation.model), simulation, scan, 0.3)
    places = torch.tensor([[0.0, 0.0, 0.3], [0.0, 0.0, 1.1]], device="cpu")
    found = rays(places, torch.tensor([0.0, np.pi], device="cpu"))
    # the second one is 0.8 m above where it stands, turned about, and sees no farther down than 0.4 m
    np.testing.assert_allclose(found.numpy(), [[0.0, 0.0, 0.2], [-0.4, -0.4, -0.4]], atol=1e-6)


def test_who_leaves_the_patch_is_outside():
    task = rolling(5)
    places = torch.tensor([[0.0, 0.0], [3.4, -3.4], [3.6, 0.0], [0.0, -3.6], [-3.6, 5.0]])
    assert task.ground.outside(places).tolist() == [False, False, True, True, True]
    assert not rolling(5, ground=Ground.FLAT).ground.outside(places).any()
    put(task, torch.tensor([0.0, 3.7, 0.0, -3.7, 0.0]), torch.zeros(5), 1.4)
    result = task.step(idle(task))
    assert result.truncated.tolist() == [False, True, False, True, False]


# ---- levels ------------------------------------------------------------------------------------------------------


def test_without_training_levels_and_kinds_are_drawn():
    task = rolling(300)
    for kind in range(3):
        assert 70 < int((task.ground.kind == kind).sum()) < 130
    counts = torch.bincount(task.ground.level, minlength=LEVELS)
    assert counts.min() > 10
    before = task.ground.level.clone()
    finish(task, 100.0, 10.0)
    task.restart()  # the next episodes
    assert not torch.equal(before, task.ground.level)
    assert task.metrics()["level"].tolist() == task.ground.level.tolist()
    fixed = rolling(50, rough=RoughConfig(level=4))
    assert fixed.ground.level.tolist() == [4] * 50
    assert len(fixed.ground.kind.unique()) > 4


def test_a_climb_begins_on_the_first_levels_and_keeps_the_kind():
    task = rolling(30, first_world=30, rough=RoughConfig(kinds=(GroundKind.FLAT, GroundKind.GAPS), first=2))
    shown = task.ground.level.clone(), task.ground.kind.clone()
    task.on_iteration(0)
    # running episodes go on as they were
    assert torch.equal(task.ground.level, shown[0])
    assert torch.equal(task.ground.kind, shown[1])
    finish(task, 100.0, 10.0)
    assert set(task.ground.level.tolist()) == {0, 1, 2}
    first = task.ground.level.clone()
    assert task.ground.kind.tolist() == [0, 1] * 15
    task.on_iteration(1)  # again is as once
    finish(task, 100.0, 10.0)
    assert torch.equal(task.ground.level, first + 1)
    assert task.ground.kind.tolist() == [0, 1] * 15
    never = rolling(30, rough=RoughConfig(climbing=Climbing.NEVER))
    never.on_iteration(0)
    assert not never.ground.extra_state()["ground_climbing"].any()
    always = rolling(30, rough=RoughConfig(climbing=Climbing.ALWAYS))
    assert always.ground.level.tolist() == [0] * 30


def test_levels_follow_the_way_that_was_walked():
    task, worlds = rolling(200, rough=RoughConfig(climbing=Climbing.ALWAYS, first=LEVELS - 1)), 200
    draws = torch.Generator().manual_seed(1)
    ground, dt = task.ground, task.config.control_dt
    assert isinstance(ground, RoughGround)
    judged = {"up": 0, "down": 0, "stay": 0, "mastered": 0}
    for _ in range(6):
        climbers = [Climber(int(level), reach=3.5, beyond=1.5, up=0.75, down=0.5, least=1.0) for level in ground.level]
        # long episodes, of steps of a second: from none to twice the command, which is none in every tenth world
        command = torch.randn(worlds, 2, generator=draws) * (torch.rand(worlds, 1, generator=draws) > 0.1)
        share, aside = torch.rand(2, worlds, 1, generator=draws) * 2.0 - 0.2
        steps = torch.randint(1, 12, (worlds,), generator=draws)
        for step in range(12):
            going = step < steps
            task.episode_clock.copy_(torch.where(going, step + 1, task.episode_clock))
            velocity = share * command + aside * command.flip(1) * torch.tensor([-1.0, 1.0])
            left = (task.config.max_episode_steps - task.episode_clock) * dt
            place = torch.randn(worlds, 3, generator=draws)
            task.views.body_q[:, task.ball, :3] = place
            before = {name: values.clone() for name, values in ground.extra_state().items()}
            for _ in range(40):  # of 0.02 s
                ground.record(velocity, command)
            for name, values in ground.extra_state().items():
                values.copy_(torch.where(going, values, before[name]))
            for world, climber in enumerate(climbers):
                for _ in range(40 if going[world] else 0):
                    climber.walk(velocity[world].numpy(), command[world].numpy(), place[world], dt, float(left[world]))
        ground.choose(torch.ones(worlds, dtype=torch.bool))
        for world, climber in enumerate(climbers):
            verdict, level = climber.judge(), int(ground.level[world])
            if verdict == "up" and climber.level == LEVELS - 1:
                judged["mastered"] += 1
                assert 0 <= level < LEVELS
                continue
            judged[verdict] += 1
            change = {"up": 1, "down": -1 if climber.level else 0, "stay": 0}[verdict]
            assert level == climber.level + change, (world, verdict)
    assert min(judged.values()) > 20


def test_who_masters_the_last_level_goes_to_any():
    task = rolling(200, rough=RoughConfig(climbing=Climbing.ALWAYS))
    for level in range(LEVELS):
        assert task.ground.level.tolist() == [level] * 200
        finish(task, 10.0, 10.0)
    counts = torch.bincount(task.ground.level, minlength=LEVELS)
    # 20 worlds on each of ten levels, five standard deviations of 4.2
    assert counts.min() > 0
    assert counts.max() < 42


def test_who_masters_the_last_level_may_stay_there():
    task = rolling(3, rough=RoughConfig(climbing=Climbing.ALWAYS, first=0, again=False))
    for level in [*range(LEVELS), LEVELS - 1, LEVELS - 1]:
        assert task.ground.level.tolist() == [level] * 3
        finish(task, 10.0, 10.0)


def test_an_episode_that_was_not_to_walk_decides_nothing():
    task = rolling(3, rough=RoughConfig(climbing=Climbing.ALWAYS, first=LEVELS - 1))
    before = task.ground.level.clone()
    for walked in (0.0, 0.9, 5.0):
        finish(task, walked, 0.9)
        assert torch.equal(task.ground.level, before)


def test_other_worlds_do_not_matter():
    tasks = [rolling(6, seed=3, rough=RoughConfig(climbing=Climbing.ALWAYS, first=5)) for _ in range(2)]
    for step in range(90):
        action = torch.full((6, 2), 0.5)
        for index, task in enumerate(tasks):
            task.step(action + (torch.tensor([[0.0], [0.0], [0.0], [-0.9 * index], [0.0], [0.0]])))
        others = [0, 1, 2, 4, 5]
        for name, values in tasks[0].ground.extra_state().items():
            assert torch.equal(values[others], tasks[1].ground.extra_state()[name][others]), (step, name)
        assert torch.equal(tasks[0].views.body_q[others], tasks[1].views.body_q[others])
    assert not torch.equal(tasks[0].views.body_q[3], tasks[1].views.body_q[3])
    # a batch that is the second half of a larger one
    half = rolling(3, seed=3, first_world=3, rough=RoughConfig(climbing=Climbing.ALWAYS, first=5))
    whole = rolling(6, seed=3, rough=RoughConfig(climbing=Climbing.ALWAYS, first=5))
    for task in (half, whole):
        for _ in range(60):
            task.step(torch.full((task.num_worlds, 2), 0.5))
    assert torch.equal(half.views.body_q, whole.views.body_q[3:])
    assert torch.equal(half.ground.level, whole.ground.level[3:])


def test_only_worlds_of_the_mask_get_another_patch():
    task = rolling(8)
    before = {name: values.clone() for name, values in task.ground.extra_state().items()}
    assets = to_torch(task.simulation.model.shape_asset)[:, task.ground.shape].clone()
    mask = torch.arange(8, device=task.device) % 2 == 0
    task.episode_index += 1
    task.ground.choose(mask)
    for name, values in task.ground.extra_state().items():
        assert torch.equal(values[~mask], before[name][~mask])
    now = to_torch(task.simulation.model.shape_asset)[:, task.ground.shape]
    assert torch.equal(now[~mask], assets[~mask])
    assert (now[mask] != assets[mask]).any()


def test_a_resumed_run_goes_on_bit_by_bit():
    config = RoughConfig(climbing=Climbing.TRAINING, first=4)
    task = rolling(5, seed=2, rough=config)
    task.on_iteration(0)
    action = torch.tensor([0.6, 0.1]) * torch.ones(5, 2)
    for _ in range(55):
        task.step(action)
    saved = task.state_dict()
    other = rolling(5, seed=9, rough=config)
    other.load_state_dict(saved)
    shown = [to_torch(each.simulation.model.shape_asset)[:, each.ground.shape] for each in (task, other)]
    assert torch.equal(*shown)
    for _ in range(90):
        ends = [each.step(action) for each in (task, other)]
        assert torch.equal(ends[0].observations["policy"], ends[1].observations["policy"])
    for each in (task, other):
        each.on_iteration(1)
    assert all(torch.equal(values, other.ground.extra_state()[name])
               for name, values in task.ground.extra_state().items())  # fmt: skip


def test_a_step_repeats_with_the_same_seed():
    ends = []
    for _ in range(2):
        task = rolling(4, seed=11)
        for _ in range(45):
            result = task.step(0.4 * torch.ones(4, 2))
        ends.append((result.observations["policy"], task.ground.level))
    assert torch.equal(ends[0][0], ends[1][0])
    assert torch.equal(ends[0][1], ends[1][1])


# ---- pictures, configurations ------------------------------------------------------------------------------------


def test_patches_have_the_color_of_their_level():
    task = rolling(12)
    scene = task.scene()
    assert task.scene() is scene
    instance = scene.instance("ground")
    colors = torch.from_numpy(level_colors().astype(np.float32))
    for _ in range(3):
        assert torch.equal(to_torch(scene.color)[:, instance], colors[task.ground.level])
        task.restart()
    # what is not the ground keeps its colour
    ball = to_torch(scene.color)[:, scene.instance("ball")]
    assert (ball == ball[0]).all()
    assert len(rolling(2, ground=Ground.FLAT).scene().names) == 2


def test_the_live_viewer_shows_each_patch_in_the_color_of_its_level():
    task = rolling(9)
    shown = Batches(task.scene(), list(range(9)))
    for _ in range(2):
        patches = [batch for batch in shown.batches if batch.key[0] == ShapeType.HEIGHT_FIELD]
        seen = {int(row): color for batch in patches for row, color in zip(batch.rows, batch.colors, strict=True)}
        assert sorted(seen) == list(range(9))
        for world, level in enumerate(task.ground.level.tolist()):
            # times the mean of the checker's squares; in bytes
            np.testing.assert_allclose(seen[world], 255.0 * 0.925 * level_colors()[level], atol=1.0)
        task.restart()
        assert shown.read_scenery()


def test_configurations_are_held_to_their_rules():
    with pytest.raises(InputError, match="kinds must be at least one kind of ground"):
        RoughConfig(kinds=())
    with pytest.raises(InputError, match=r"down must be at most up, got 0\.9"):
        RoughConfig(down=0.9)
    for wrong in ({"level": 10}, {"variants": 0}, {"first": -1}, {"kinds": ("swamp",)}, {"climbing": "often"}):
        with pytest.raises(InputError):
            RoughConfig(**wrong)
    with pytest.raises(InputError):
        ScanConfig(ahead=0)
    made = config_from_plain(RoughConfig, config_to_plain(EVERY))
    assert made == EVERY
    assert isinstance(ground_of(Ground.ROUGH, 0.3), RoughGround)
    assert not isinstance(ground_of(Ground.FLAT, 0.3), RoughGround)
