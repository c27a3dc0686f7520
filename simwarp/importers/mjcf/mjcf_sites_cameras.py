"""Sites, cameras, keyframes and sensors of MJCF."""

from __future__ import annotations

import math
from typing import Final

import mujoco
import numpy as np

from simwarp.importers.coordinates import CoordinateMap
from simwarp.importers.imported import CameraPlace, Keyframe, NamedFrame, SourceSensor
from simwarp.importers.mjcf.mjcf_source import Source
from simwarp.importers.mjcf.mjcf_unsupported import is_off

SENSORS: Final = frozenset(
    {
        "gyro", "accelerometer", "velocimeter", "magnetometer", "framepos", "framequat", "framexaxis", "frameyaxis",
        "framezaxis", "framelinvel", "frameangvel", "framelinacc", "frameangacc", "jointpos", "jointvel", "touch",
        "force", "torque", "rangefinder",
    }
)  # fmt: skip
"""Kinds of sensors whose place is kept; those of simwarp are mounted there."""


def sites_of(source: Source) -> dict[str, NamedFrame]:
    """Sites by name."""
    model, data = source.model, source.data
    found = {}
    for site in range(model.nsite):
        pose = source.pose_of_axes(data.site_xpos[site], data.site_xmat[site])
        found[source.name("site", site)] = source.frame(int(model.site_bodyid[site]), pose)
        source.report.hold("site", source.label("site", site))
    return found


def cameras_of(source: Source) -> dict[str, CameraPlace]:
    """Cameras by name; those that track something stand as built."""
    model, data = source.model, source.data
    found = {}
    for camera in range(model.ncam):
        label = source.label("camera", camera)
        pose = source.pose_of_axes(data.cam_xpos[camera], data.cam_xmat[camera])
        frame = source.frame(int(model.cam_bodyid[camera]), pose)
        found[source.name("camera", camera)] = CameraPlace(frame, math.radians(float(model.cam_fovy[camera])))
        if model.cam_mode[camera] == mujoco.mjtCamLight.mjCAMLIGHT_FIXED:
            source.report.hold("camera", label)
        else:
            source.report.approximate("camera mode", label, "it is fixed to its body instead of tracking")
    return found


def keyframes_of(source: Source, coordinates: CoordinateMap) -> dict[str, Keyframe]:
    """Keyframes by name."""
    model = source.model
    controls = 0 if is_off(model, "actuation") else int(model.nu)
    found = {}
    for key in range(model.nkey):
        qpos = np.asarray(model.key_qpos[key], np.float64)
        found[source.name("key", key)] = Keyframe(
            q=coordinates.q_from(qpos), qd=coordinates.qd_from(model.key_qvel[key], qpos),
            ctrl=np.asarray(model.key_ctrl[key][:controls], np.float64), time=float(model.key_time[key]),
        )  # fmt: skip
        source.report.hold("keyframe", source.label("key", key))
    return found


def sensors_of(source: Source, sites: dict[str, NamedFrame]) -> dict[str, SourceSensor]:
    """Places of sensors by name; kinds without a counterpart are left out and label."""
    model = source.model
    found = {}
    for sensor in range(model.nsensor):
        label = source.label("sensor", sensor)
        kind = mujoco.mjtSensor(model.sensor_type[sensor]).name.removeprefix("mjSENS_").lower()
        if kind not in SENSORS:
            source.report.approximate(f"sensor {kind}", label, "left out: there is no such sensor")
            continue
        source.report.hold(f"sensor {kind}", label)
        what, index = mujoco.mjtObj(model.sensor_objtype[sensor]), int(model.sensor_objid[sensor])
        joint, frame = "", None
        if what == mujoco.mjtObj.mjOBJ_JOINT:
            joint = source.name("joint", index)
        elif what == mujoco.mjtObj.mjOBJ_SITE:
            frame = sites[source.name("site", index)]
        elif what in (mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_XBODY):
            body_pose = source.pose(source.data.xpos[index], source.data.xquat[index])
            frame = source.frame(index, body_pose)
        found[source.name("sensor", sensor)] = SourceSensor(
            kind=kind, frame=frame, joint=joint, noise=float(model.sensor_noise[sensor]),
            cutoff=float(model.sensor_cutoff[sensor]),
        )  # fmt: skip
    return found
