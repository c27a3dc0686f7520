"""The sensors of `simwarp sensor-demo`, and the drive on which they measure."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.rotation import matrix_of
from simwarp.core.types import Vec3
from simwarp.sensors.cameras.camera import Camera, CameraConfig, look_at
from simwarp.sensors.cameras.image_processing import Imaging
from simwarp.sensors.cameras.lenses import FishEye, Pinhole, Radial
from simwarp.sensors.cameras.lights import Lighting, Lights, Sun
from simwarp.sensors.interface import Mount, Schedule, Sensor
from simwarp.sensors.motion.encoders import Encoder, EncoderConfig, Speedometer
from simwarp.sensors.motion.gps import Gps, GpsConfig
from simwarp.sensors.motion.imu import Imu, ImuConfig
from simwarp.sensors.noise import BoundedDrift, NormalNoise
from simwarp.sensors.presets import load_config
from simwarp.sensors.ranging.beams import beam_grid
from simwarp.sensors.ranging.lidar import Lidar, LidarConfig, LidarNoise
from simwarp.sensors.ranging.radar import Clusters, Radar, RadarConfig, RadarNoise
from simwarp.simulation.simulation import Simulation
from simwarp.vehicle.vehicle import VEHICLE_SOLVER
from simwarp.viewer.demo.landscape import ROOF, DemoWorld

Array = npt.NDArray[Any]
Progress = Callable[[str, float], None]
"""Called with the present stage, and the share of it that is done."""

DT: Final = 0.002
BLUR: Final = 0.06
"""Exposure time of the camera that blurs [s]."""
SWEEP: Final = 0.05
"""Of the lidar [s]."""
COUNTS: Final = 100
"""Of the wheel's encoder per turn."""

DAY: Final = Lighting(suns=(Sun(direction=(-0.25, -0.75, 0.6), color=(1.02, 0.96, 0.84)),))
FOG: Final = dataclasses.replace(
    DAY, fog_density=0.035, fog=(0.66, 0.69, 0.72), sky=(0.6, 0.65, 0.7), horizon=(0.66, 0.69, 0.72),
    suns=(Sun(direction=(-0.25, -0.75, 0.6), color=(0.5, 0.49, 0.47)),), ambient=(0.42, 0.44, 0.47),
)  # fmt: skip
CHASE: Final = ((-7.2, 3.0, 2.6), (6.0, -0.9, 0.3))
FRONT: Final = ((0.85, 0.0, 1.25), (10.0, 0.0, 0.4))
DOWN: Final = ((0.85, 0.0, 1.25), (10.0, 0.0, -3.2))
ASIDE: Final = ((0.6, 0.8, 1.3), (6.0, 6.2, 0.1))
"""Position of each camera and the point that it looks at, in the truck's frame of reference [m]."""


@dataclasses.dataclass(frozen=True)
class SensorSuite:
    """All sensors: imaging ones (`cameras`, `lidar`, `radar`) and those recorded during the whole drive (`traced`)."""

    cameras: Mapping[str, Camera]
    lidar: Lidar
    radar: Radar
    traced: Mapping[str, Sensor]

    @property
    def sensors(self) -> list[Sensor]:
        """For the Simulation."""
        return [*self.cameras.values(), self.lidar, self.radar, *self.traced.values()]


def make_sensor_suite(world: DemoWorld, seed: int, panel: int) -> SensorSuite:
    """All sensors on the truck.

    Args:
        world: with the truck.
        seed: of their noise.
        panel: width of the small pictures [pixels].
    """
    once = Schedule(rate=1.0 / world.moment)
    day, fog = (Lights(light, 1, world.model.device) for light in (DAY, FOG))
    big = big_size(panel)

    def camera(name: str, place: tuple[Vec3, Vec3], lights: Lights = day, **options: Any) -> Camera:
        usual = {"width": panel, "height": small_height(panel), "schedule": once, "samples": 2, "near": 0.05,
                 "far": 400.0}  # fmt: skip
        config = CameraConfig(**{**usual, **options})
        return Camera(world.scene, _mount(world, place), config, lights=lights, name=name, seed=seed)

    cameras = {
        "rgb": camera("rgb", CHASE, lens=Pinhole(fov=1.1), samples=3, width=big[0], height=big[1]),
        "outputs": camera(
            "outputs", CHASE, lens=Pinhole(fov=1.1), outputs=("grey", "depth", "normals", "instance", "semantic")
        ),
        "pinhole": camera("pinhole", FRONT, lens=Pinhole(fov=1.9)),
        "fish-eye": camera("fish-eye", DOWN, lens=FishEye(fov=3.4)),
        "radial": camera("radial", FRONT, lens=Radial(fov=1.9, k1=-0.22, k2=0.045)),
        "noise": camera(
            "noise", FRONT, lens=Pinhole(fov=1.2),
            imaging=Imaging(exposure=0.2, noise_slope=0.012, noise_intercept=0.0006),
        ),
        "blur": camera(
            "blur", ASIDE, schedule=Schedule(rate=once.rate, window=BLUR), lens=Pinhole(fov=1.2), samples=1
        ),
        "fog": camera("fog", FRONT, fog, lens=Pinhole(fov=1.2)),
        "exposure": camera(
            "exposure", FRONT, lens=Pinhole(fov=1.9), imaging=Imaging(exposure=1.9, vignetting=1.0)
        ),
    }  # fmt: skip
    roof = _mount(world, (ROOF, (ROOF[0] + 1.0, ROOF[1], ROOF[2])))
    vlp = load_config(
        "vlp-16", schedule=Schedule(rate=once.rate, window=SWEEP), noise=LidarNoise(range=0.02, dropout=0.01), near=0.4
    )
    assert isinstance(vlp, LidarConfig)
    lidar = Lidar(world.scene, roof, vlp, seed=seed)
    return SensorSuite(cameras, lidar, _radar(world, once, seed), _traced(world, seed))


def _radar(world: DemoWorld, once: Schedule, seed: int) -> Radar:
    config = RadarConfig(
        schedule=once, rays=beam_grid(121, 9, azimuth=(0.8, -0.8), elevation=(0.06, -0.1)), far=60.0,
        noise=RadarNoise(range=0.1, azimuth=0.004, velocity=0.1, threshold=0.12),
        clusters=Clusters(distance=1.6, least=3),
    )  # fmt: skip
    front = (2.45, 0.0, 0.35)
    return Radar(world.scene, _mount(world, (front, (10.0, 0.0, 0.35))), config, seed=seed)


def _traced(world: DemoWorld, seed: int) -> dict[str, Sensor]:
    """Sensors that are recorded during the whole drive, by name."""
    model, parts = world.model, world.parts
    middle = _mount(world, ((0.0, 0.0, 0.3), (1.0, 0.0, 0.3)))
    imu = ImuConfig(
        schedule=Schedule(rate=100.0, window=0.01),
        accelerometer_noise=(NormalNoise(std=0.25), BoundedDrift(std=0.15, time=30.0)),
        gyroscope_noise=(NormalNoise(std=0.015, mean=(0.0, 0.0, 0.03)), BoundedDrift(std=0.01, time=30.0)),
    )
    gps = GpsConfig(
        schedule=Schedule(rate=5.0), noise=(NormalNoise(std=(0.3, 0.3, 0.6)), BoundedDrift(std=0.8, time=15.0)),
        velocity_noise=(NormalNoise(std=0.12),),
    )  # fmt: skip
    wheel = EncoderConfig(schedule=Schedule(rate=10.0, window=0.1), reading="speed", counts_per_turn=COUNTS)
    return {
        "imu": Imu(model, middle, imu, seed=seed),
        "gps": Gps(model, middle, gps, seed=seed),
        "encoder": Encoder(model, model.joint_dof_start[parts.sides[0].turn], wheel, seed=seed),
        "speedometer": Speedometer(model, middle),
    }


def _mount(world: DemoWorld, place: tuple[Vec3, Vec3]) -> Mount:
    """On the chassis: from a place to a target in the truck's frame of reference."""
    eye, target = (np.asarray(point) + world.parts.reference for point in place)
    return Mount(world.parts.chassis, look_at(eye, target))


def small_height(panel: int) -> int:
    """Of small pictures [pixels]."""
    return 2 * round(panel * 9 / 32)


def big_size(panel: int) -> tuple[int, int]:
    """Width and height of a picture that is two small ones wide and high, with what is between them [pixels]."""
    from simwarp.viewer.demo.sheet import CAPTION, GAP

    return 2 * panel + GAP, 2 * small_height(panel) + CAPTION + GAP


def drive(world: DemoWorld, rig: SensorSuite, report: Progress) -> tuple[dict[str, dict[str, Array]], Simulation]:
    """Drives until all sensors have seen the moment.

    Returns:
        Time [s], data, truth and other fields of the sensors that are recorded all the way, by their names; and the
        simulation at its end.
    """
    scene = world.scene
    # the frames of the start are nobody's: rays that meet nothing cost little
    scene.enabled.fill_(0)
    simulation = Simulation(
        world.model, DT, elements=[world.driver, world.vehicle], sensors=rig.sensors, solver=VEHICLE_SOLVER
    )
    last = round((world.moment + max(SWEEP, BLUR)) / DT) + 1
    rows: dict[str, list[tuple[float, dict[str, Array]]]] = {name: [] for name in rig.traced}
    pictures = round(world.moment / DT)
    for step in range(1, last + 1):
        if step % 250 == 0 or step >= pictures:
            report("taking pictures" if step >= pictures else "driving", step / last)
        simulation.step()
        if step == last // 2:
            scene.enabled.fill_(1)
        for name, sensor in rig.traced.items():
            now = float(sensor.timestamp.numpy()[0])
            if now > (rows[name][-1][0] if rows[name] else 0.0):
                rows[name].append((now, _fields(sensor)))
    return {name: _columns(found) for name, found in rows.items()}, simulation


def cloud_points(world: DemoWorld, rig: SensorSuite, simulation: Simulation) -> tuple[Array, Array]:
    """(n, 3) returns of the lidar in world axes, each from where the lidar was when its beam fired; and where it is
    now, (3,) [m].
    """
    state, body, mount = simulation.state, world.parts.chassis, rig.lidar.mount
    turn = matrix_of(state.body_rot.numpy()[0, body])
    arm = turn @ mount.position.numpy()[0]
    place = state.body_x.numpy()[0, body] + arm
    velocity = state.body_v.numpy()[0, body] + np.cross(state.body_omega.numpy()[0, body], arm)
    axes = turn @ matrix_of(mount.rotation.numpy()[0])
    points = rig.lidar.points.numpy()[0]
    # from the beginning of the sweep to the present state
    passed = float(simulation.time.numpy()[0]) - rig.lidar.timestamp.numpy()[0] + SWEEP
    ago = passed - SWEEP * np.arange(points.shape[1]) / points.shape[1]
    cloud = points[..., :3] @ axes.T + (place - velocity * ago[:, None])[None]
    return cloud[points[..., 3] > 0.0], place


def _fields(sensor: Any) -> dict[str, Array]:
    names = [name for name in sensor.frames.data if name not in ("count",)]
    return {name: sensor.frames.data[name].numpy()[0].copy() for name in names}


def _columns(rows: Sequence[tuple[float, dict[str, Array]]]) -> dict[str, Array]:
    found = {"time": np.array([time for time, _ in rows])}
    return found | {name: np.stack([fields[name] for _, fields in rows]) for name in rows[0][1]}
