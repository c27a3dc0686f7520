"""Sensors: cameras, lidar and radar by ray casting; inertial, satellite, magnetic, joint and force sensors.

scene = sw.sensors.Scene(model, visuals)
camera = sw.sensors.Camera(scene, sw.sensors.Mount("chassis"), sw.sensors.CameraConfig(width=160, height=90))

Names are imported on first use: few commands need all of them, and kernels take a while to import.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from simwarp.core.names_on_demand import names_on_demand

if TYPE_CHECKING:
    from simwarp.sensors.cameras.appearance import CheckerTexture, ImageTexture, NoiseTexture
    from simwarp.sensors.cameras.camera import Camera, CameraConfig, look_at
    from simwarp.sensors.cameras.image_processing import Imaging
    from simwarp.sensors.cameras.lenses import FishEye, Pinhole, Radial
    from simwarp.sensors.cameras.lights import Lamp, Lighting, Lights, Sun
    from simwarp.sensors.clock import Field, FrameBuffer, mount_arrays
    from simwarp.sensors.frame_sensor import FrameSensor
    from simwarp.sensors.instances import Appearance
    from simwarp.sensors.interface import Mount, Schedule, Sensor
    from simwarp.sensors.motion.encoders import (
        Encoder,
        EncoderConfig,
        Speedometer,
        SpeedometerConfig,
        Tachometer,
        TachometerConfig,
    )
    from simwarp.sensors.motion.force_sensor import ContactSensor, ContactSensorConfig, LoadCell, LoadCellConfig
    from simwarp.sensors.motion.gps import GeoOrigin, Gps, GpsConfig
    from simwarp.sensors.motion.imu import Imu, ImuConfig
    from simwarp.sensors.motion.magnetometer import Magnetometer, MagnetometerConfig
    from simwarp.sensors.noise import BiasWalk, BoundedDrift, NormalNoise, Quantisation, Saturation
    from simwarp.sensors.presets import load_config, load_sensor, make_sensor
    from simwarp.sensors.ranging.beams import Beam, BeamTable, beam_grid
    from simwarp.sensors.ranging.lidar import Lidar, LidarConfig, LidarNoise
    from simwarp.sensors.ranging.radar import Clusters, Radar, RadarConfig, RadarNoise
    from simwarp.sensors.scene import Scene, Visuals
    from simwarp.sensors.shipped import sensor_names

__all__ = [
    "Appearance",
    "Beam",
    "BeamTable",
    "BiasWalk",
    "BoundedDrift",
    "Camera",
    "CameraConfig",
    "CheckerTexture",
    "Clusters",
    "ContactSensor",
    "ContactSensorConfig",
    "Encoder",
    "EncoderConfig",
    "Field",
    "FishEye",
    "FrameBuffer",
    "FrameSensor",
    "GeoOrigin",
    "Gps",
    "GpsConfig",
    "ImageTexture",
    "Imaging",
    "Imu",
    "ImuConfig",
    "Lamp",
    "Lidar",
    "LidarConfig",
    "LidarNoise",
    "Lighting",
    "Lights",
    "LoadCell",
    "LoadCellConfig",
    "Magnetometer",
    "MagnetometerConfig",
    "Mount",
    "NoiseTexture",
    "NormalNoise",
    "Pinhole",
    "Quantisation",
    "Radar",
    "RadarConfig",
    "RadarNoise",
    "Radial",
    "Saturation",
    "Scene",
    "Schedule",
    "Sensor",
    "Speedometer",
    "SpeedometerConfig",
    "Sun",
    "Tachometer",
    "TachometerConfig",
    "Visuals",
    "beam_grid",
    "load_config",
    "load_sensor",
    "look_at",
    "make_sensor",
    "mount_arrays",
    "sensor_names",
]

_MODULES: Final = {
    "Appearance": "instances", "Beam": "ranging.beams", "BeamTable": "ranging.beams", "BiasWalk": "noise",
    "BoundedDrift": "noise", "Camera": "cameras.camera", "CameraConfig": "cameras.camera",
    "CheckerTexture": "cameras.appearance", "Clusters": "ranging.radar", "ContactSensor": "motion.force_sensor",
    "ContactSensorConfig": "motion.force_sensor", "Encoder": "motion.encoders", "EncoderConfig": "motion.encoders",
    "Field": "clock", "FishEye": "cameras.lenses", "FrameBuffer": "clock", "FrameSensor": "frame_sensor",
    "GeoOrigin": "motion.gps", "Gps": "motion.gps", "GpsConfig": "motion.gps", "ImageTexture": "cameras.appearance",
    "Imaging": "cameras.image_processing", "Imu": "motion.imu", "ImuConfig": "motion.imu", "Lamp": "cameras.lights",
    "Lidar": "ranging.lidar", "LidarConfig": "ranging.lidar", "LidarNoise": "ranging.lidar",
    "Lighting": "cameras.lights", "Lights": "cameras.lights", "LoadCell": "motion.force_sensor",
    "LoadCellConfig": "motion.force_sensor", "Magnetometer": "motion.magnetometer",
    "MagnetometerConfig": "motion.magnetometer", "Mount": "interface", "NoiseTexture": "cameras.appearance",
    "NormalNoise": "noise", "Pinhole": "cameras.lenses", "Quantisation": "noise", "Radar": "ranging.radar",
    "RadarConfig": "ranging.radar", "RadarNoise": "ranging.radar", "Radial": "cameras.lenses", "Saturation": "noise",
    "Scene": "scene", "Schedule": "interface", "Sensor": "interface", "Speedometer": "motion.encoders",
    "SpeedometerConfig": "motion.encoders", "Sun": "cameras.lights", "Tachometer": "motion.encoders",
    "TachometerConfig": "motion.encoders", "Visuals": "scene", "beam_grid": "ranging.beams", "load_config": "presets",
    "load_sensor": "presets", "look_at": "cameras.camera", "make_sensor": "presets", "mount_arrays": "clock",
    "sensor_names": "shipped",
}  # fmt: skip

__getattr__ = names_on_demand(__name__, _MODULES)
