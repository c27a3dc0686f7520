"""Writers of what other programs read.

model = builder.finalize(world_count=1, device="cpu")
sw.exporters.save_mjcf(model, "robot.xml")
"""

from __future__ import annotations

from simwarp.exporters.mjcf_joints import FileJoint
from simwarp.exporters.mjcf_writer import Mjcf, mjcf_of, save_mjcf

__all__ = ["FileJoint", "Mjcf", "mjcf_of", "save_mjcf"]
