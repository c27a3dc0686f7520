"""Writers of what other programs read.

model = builder.finalize(world_count=1, device="cpu")
sw.exporters.save_mjcf(model, "robot.xml")

recording = sw.exporters.SceneRecording(simulation, scene)
recording.add(0.0)
sw.exporters.save_scene(recording, "scene.glb")
"""

from __future__ import annotations

from simwarp.exporters.mjcf_joints import FileJoint
from simwarp.exporters.mjcf_writer import Mjcf, mjcf_of, save_mjcf
from simwarp.exporters.scene_files import save_scene
from simwarp.exporters.scene_recording import SceneRecording
from simwarp.exporters.vehicle_fmu import save_fmu

__all__ = ["FileJoint", "Mjcf", "SceneRecording", "mjcf_of", "save_fmu", "save_mjcf", "save_scene"]
