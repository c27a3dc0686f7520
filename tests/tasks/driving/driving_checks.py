"""What tests of driving tasks share: scripted drives, and geometry read from the arrays that contact and tires read."""

import math
from typing import Any

import numpy as np
import torch

from simwarp.core.interop import to_torch
from simwarp.core.types import WORLD, ShapeType
from simwarp.scenery.terrain import height_at
from simwarp.tasks import make

NAMES = ("barrier-track", "convoy", "hallway", "obstacle-avoidance", "off-road")
SMALL: dict[str, Any] = {"obs": "camera", "camera_width": 40, "camera_height": 36}
"""The smallest image that tasks take, but for four columns."""


def driving(name, worlds=2, *, seed=0, **options):
    """A task without a camera, unless options say otherwise; pictures of all sixteen tracks take seconds to build."""
    few = {"tracks": 2} if name == "barrier-track" and options.get("obs") == "camera" else {}
    return make(name, worlds, seed=seed, **{"obs": "state", **few, **options})


def random_actions(task, steps, seed=0):
    """(steps, W, A) of the whole range."""
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(steps, task.num_worlds, task.action_size, generator=generator) * 2.0 - 1.0


def held(task, steering=0.0, pedal=0.0):
    """(W, A): the same for all worlds, or a number for each."""
    action = torch.zeros(task.num_worlds, task.action_size)
    action[:, 0] = torch.as_tensor(steering)
    if task.action_size > 1:
        action[:, 1] = torch.as_tensor(pedal)
    return action


def copied(groups):
    return {name: group.clone() for name, group in groups.items()}


def reason(task, result, world=0):
    """Name of the reason that an episode ended for; None while it runs."""
    index = int(result.end_reason[world])
    return task.end_reasons[index] if index >= 0 else None


def term(task, result, name):
    """(W,) one term of the reward."""
    return result.reward_terms[:, task.reward_terms.index(name)]


def drive(task, policy, steps):
    """Step until world 0 ends: (results so far, why it ended)."""
    results = []
    for _ in range(steps):
        results.append(task.step(policy(task)))
        if reason(task, results[-1]) is not None:
            break
    return results, reason(task, results[-1])


def chase(task, point, *, speed=4.0, gain=2.0):
    """(W, A) towards points (W, 2) of the world, at a speed."""
    place, heading = task.pose()
    away = torch.as_tensor(point, dtype=torch.float64) - place[:, :2]
    turn = torch.atan2(away[:, 1], away[:, 0]) - heading
    turn = torch.atan2(turn.sin(), turn.cos())
    return held(task, (gain * turn).clamp(-1.0, 1.0).float(), (0.5 * (speed - task.motion()[:, 0])).clamp(-1.0, 1.0))


# ---- geometry --------------------------------------------------------------------------------------------------


def turned(rotation, vectors):
    """Vectors (..., 3) turned by quaternions xyzw (..., 4)."""
    axis, vectors = torch.broadcast_tensors(rotation[..., :3], vectors)
    twice = 2.0 * torch.linalg.cross(axis, vectors, dim=-1)
    return vectors + rotation[..., 3:] * twice + torch.linalg.cross(axis, twice, dim=-1)


def _corners(half):
    signs = torch.tensor([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=torch.float64)
    return signs * torch.as_tensor(half, dtype=torch.float64)


def wheels(task):
    """Centres (W, 4, 3), axes (W, 4, 3), radii (4,) and widths (4,) [m] of the wheels."""
    bodies = [side.spindle for side in task.parts.sides]
    centre = to_torch(task.simulation.state.body_x)[:, bodies].clone()
    axis = turned(to_torch(task.simulation.state.body_rot)[:, bodies], torch.tensor([0.0, 1.0, 0.0]).double())
    tires = [task.spec.axles[side.axle].tire for side in task.parts.sides]
    return centre, axis, [tire.radius for tire in tires], [tire.width for tire in tires]


def vehicle_corners(task):
    """(W, P, 3) corners of the chassis' box in contact and of boxes around the wheels [m]."""
    model, state, box = task.simulation.model, task.simulation.state, task.chassis_shape
    body = task.builder.shapes[box].body
    x, rotation = to_torch(state.body_x)[:, body, None], to_torch(state.body_rot)[:, body, None].double()
    local = to_torch(model.shape_x)[:, box, None] + turned(
        to_torch(model.shape_rot)[:, box, None].double(), _corners(to_torch(model.shape_size)[0, box].tolist())
    )
    parts = [x + turned(rotation, local)]
    centre, axis, radii, widths = wheels(task)
    for index, (radius, width) in enumerate(zip(radii, widths, strict=True)):
        along = axis[:, index]
        ahead = torch.linalg.cross(along, torch.tensor([0.0, 0.0, 1.0]).double().expand_as(along))
        ahead = ahead / ahead.norm(dim=1, keepdim=True)
        frame = torch.stack([ahead, along, torch.linalg.cross(ahead, along)], dim=2)
        local = _corners((radius, 0.5 * width, radius)).expand(len(along), -1, -1)
        parts.append(centre[:, index, None] + local @ frame.transpose(1, 2))
    return torch.cat(parts, dim=1)


def world_shapes(task):
    """Indices of the shapes of the world that the chassis can touch, as group and mask tell."""
    own = task.builder.shapes[task.chassis_shape]
    return [
        index
        for index, shape in enumerate(task.builder.shapes)
        if shape.body == WORLD and shape.type in (ShapeType.HULL, ShapeType.BOX) and shape.group & own.mask
        and own.group & shape.mask
    ]  # fmt: skip


def obstacle_corners(task):
    """(W, N, V, 3) corners of all that the chassis can touch, from the model's arrays, and (W, N) what is there."""
    model, builder = task.simulation.model, task.builder
    shapes = world_shapes(task)
    tables = [_corners((1.0, 1.0, 1.0))] + [
        torch.as_tensor(hull.vertices, dtype=torch.float64) for hull in builder.hulls
    ]
    most = max(map(len, tables))
    table = torch.stack([torch.cat([points, points[:1].expand(most - len(points), 3)]) for points in tables])
    worlds = task.num_worlds
    kinds = torch.tensor([0 if builder.shapes[index].type == ShapeType.BOX else 1 for index in shapes])

    def rows(name):
        array = to_torch(getattr(model, name))[:, shapes]
        return array.expand(worlds, *array.shape[1:])

    asset = torch.where(kinds == 0, 0, rows("shape_asset").long() + 1)
    local = table[asset] * rows("shape_size").double().unsqueeze(2)
    points = rows("shape_x").unsqueeze(2) + turned(rows("shape_rot").double().unsqueeze(2), local)
    return points, rows("shape_enabled").bool()


def gaps(own, others, there, directions=48):
    """(W,) least distance, seen from above, between the hull of points (W, P, 3) and those of (W, N, V, 3), at least
    [m]: of all directions, the one in which they are farthest apart. Positive: nothing of one is above the other.
    """
    angle = 2.0 * math.pi * torch.arange(directions, dtype=torch.float64) / directions
    way = torch.stack([angle.cos(), angle.sin()])
    middle = own[:, :, :2].mean(dim=1)
    far = ((own[:, :, :2] - middle[:, None]) @ way).amax(dim=1)
    near = ((others[..., :2] - middle[:, None, None]) @ way).amin(dim=2)
    apart = (near - far.unsqueeze(1)).amax(dim=2)
    return torch.where(there, apart, torch.inf).amin(dim=1)


def ground_heights(task, points):
    """(W, N) heights at points (W, N, 2) of the ground that the tires stand on [m]."""
    if getattr(task, "hills", None) is None:
        return np.zeros(points.shape[:2])
    terrain, fields = task.vehicle.tires.terrain, task.builder.height_fields
    asset, scale = terrain.asset.numpy(), terrain.scale.numpy()
    heights = np.zeros(points.shape[:2])
    for index, field in enumerate(fields):
        here = asset == index
        extent = [(count - 1) * step for count, step in zip(field.heights.shape[::-1], field.spacing, strict=True)]
        found = height_at(field.heights, extent, points[here].reshape(-1, 2)).reshape(-1, points.shape[1])
        heights[here] = scale[here, 2:] * found
    return heights


def wheel_gaps(task):
    """(W, 4) distance of the lowest points of the wheels from the plane of the ground below their centres [m]."""
    centre, _, radii, _ = wheels(task)
    step = 0.05
    offsets = np.array([[0.0, 0.0], [step, 0.0], [-step, 0.0], [0.0, step], [0.0, -step]])
    at = centre[:, :, None, :2].numpy() + offsets
    level = ground_heights(task, at.reshape(len(at), -1, 2)).reshape(*at.shape[:3])
    slope = np.hypot(level[..., 1] - level[..., 2], level[..., 3] - level[..., 4]) / (2.0 * step)
    return (centre[..., 2].numpy() - level[..., 0]) / np.sqrt(1.0 + slope**2) - np.array(radii)
