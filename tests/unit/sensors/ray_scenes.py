"""Small worlds for sensors that cast rays: a carrier that flies on its own, and what stands around it."""

from __future__ import annotations

import simwarp as sw
from simwarp.sensors.scene import Visuals


def carrier(fill, *, worlds=1, position=(0.0, 0.0, 0.0), rotation=(0.0, 0.0, 0.0, 1.0), velocity=(0.0, 0.0, 0.0),
            omega=(0.0, 0.0, 0.0), bodies=None, per_world=(), device="cpu"):  # fmt: skip
    """(model, scene): a body without weight called "carrier", and whatever `fill(visuals, builder)` adds."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    builder.add_body(
        "carrier", mass=1.0, inertia=(1.0, 1.0, 1.0), pose=sw.pose(position, rotation), velocity=velocity, omega=omega
    )
    for name, (where, v, turn) in (bodies or {}).items():
        builder.add_body(name, mass=1.0, inertia=(1.0, 1.0, 1.0), pose=sw.pose(where), velocity=v, omega=turn)
    visuals = Visuals(builder)
    fill(visuals, builder)
    model = builder.finalize(worlds, device)
    return model, visuals.finalize(model, per_world=per_world)
