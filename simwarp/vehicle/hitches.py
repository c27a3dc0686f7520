"""Hitches of trailers: the joint between two units, and the articulation of a train as built."""

from __future__ import annotations

import numpy as np

from simwarp.core.rotation import rotate
from simwarp.core.types import Dof, Pose
from simwarp.model.builder import ModelBuilder
from simwarp.vehicle.spec.trailer_parts import Hitch


def add_hitch(builder: ModelBuilder, name: str, hitch: Hitch, towing: int, trailer: int, frame: Pose) -> int:
    """The joint of a trailer; returns its index.

    A ball's coordinates are a rotation vector (roll, pitch, yaw for small turns); a fifth wheel's are the pitch of its
    plate on the towing unit, then the yaw of the trailer on the plate.

    Args:
        towing: chassis of the unit in front.
        trailer: chassis of the trailer.
        frame: the trailer's frame of reference in the world as built.
    """
    anchor = frame.position + rotate(frame.rotation, np.array(hitch.trailer_point))
    pitch, yaw = (
        Dof(limit=_either_way(hitch.pitch_limit)),
        Dof(limit=_either_way(hitch.yaw_limit), friction=hitch.yaw_friction, damping=hitch.yaw_damping),
    )
    if hitch.kind == "ball":
        x, y, z, w = (float(part) for part in frame.rotation)
        return builder.add_joint_spherical(
            name, towing, trailer, anchor=anchor, rotation=(x, y, z, w), dofs=(Dof(), pitch, yaw)
        )
    left, up = (rotate(frame.rotation, np.array(axis)) for axis in ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
    return builder.add_joint_universal(name, towing, trailer, anchor=anchor, axis0=left, axis1=up, dofs=(pitch, yaw))


def _either_way(limit: float | None) -> tuple[float, float] | None:
    return None if limit is None else (-limit, limit)
