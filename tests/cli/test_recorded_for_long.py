"""Ten minutes of driving as MCAP, read back: of every topic each hundredth message against the simulation's arrays."""

from __future__ import annotations

import functools
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

import simwarp as sw
from simwarp.cli.view.maneuver_scene import driven_scene
from simwarp.core.rotation import matrix_of
from simwarp.sensors import CameraConfig, LidarConfig, Mount, Schedule, beam_grid, load_config, make_sensor
from simwarp.vehicle.driving.maneuvers import maneuver
from simwarp.vehicle.results.runs import Drive, set_up
from simwarp.vehicle.tracks.tracked_files import load_any_vehicle
from tests.unit.mcap.recordings import ns, pixels, stamp, vector

MINUTES, EVERY = 10.0, 100
STATES = ("/tf", "/odom", "/joint_states", *(f"/vehicle/{name}" for name in ("commands", "engine", "wheel_states")))
STATES = (*STATES, "/vehicle/wheel_loads")
SENSORS = {
    "/imu/data": ("imu", "data"), "/gps/fix": ("gps", "data"), "/gps/vel": ("gps", "velocity"),
    "/camera/rgb/image_raw": ("camera", "rgb"), "/camera/rgb/camera_info": ("camera", ""),
    "/lidar/points": ("lidar", "points"),
}  # fmt: skip
"""Topic -> sensor, and which of its outputs."""


class Watched:
    """A drive whose every hundredth state and frame is kept beside its record."""

    def __init__(self, path: Path) -> None:
        spec = load_any_vehicle("gator")
        what = maneuver("constant-radius", spec, duration=60.0 * MINUTES)
        slow = Schedule(rate=10.0, lag=0.03)
        configs: dict[str, Any] = {
            "imu": load_config("mems-imu"), "gps": load_config("rtk-gps"),
            "camera": CameraConfig(schedule=slow, width=32, height=18),
            "lidar": LidarConfig(
                schedule=slow, beams=beam_grid(90, 8, azimuth=(3.1, -3.1), elevation=(0.2, -0.3))
            ),
        }  # fmt: skip

        def sensors(vehicle: Any, elements: Any) -> list[Any]:
            scene = driven_scene(vehicle, elements, what)
            mount = Mount(vehicle.parts.chassis, sw.pose((0.1, 0.2, 1.5)))
            return [make_sensor(config, scene, mount, name=name, seed=3) for name, config in configs.items()]

        setup = set_up(spec, what, device="cpu", dt=0.005, sensors=sensors)
        self.sim = setup.simulation
        self.vehicle: Any = setup.vehicle
        self.last = dict.fromkeys(configs, -1.0)
        self.counts: Counter[str] = Counter()
        self.kept: dict[str, list[tuple[int, int, Any]]] = defaultdict(list)
        """Of each topic: when a message was there, of when it is, its values."""
        drive = Drive(setup)
        with sw.mcap.Writer(path, self.sim) as self.writer:
            drive.after_step, drive.steps_to_call = self.step, self.writer.steps_to_next
            self.note()
            drive.run()
        self.chassis = self.vehicle.parts.chassis

    def step(self) -> None:
        self.writer.add()
        self.note()

    def note(self) -> None:
        now = float(self.sim.time.numpy()[0])
        due = round(now / 0.02)
        if due == self.counts["/tf"] and abs(now - 0.02 * due) < 0.002:
            self.keep(STATES, now, now, self.state)
        for sensor in self.sim.sensors:
            taken = float(sensor.timestamp.numpy()[0])
            if taken > self.last[sensor.name]:
                self.last[sensor.name] = taken
                topics = [topic for topic, (name, _) in SENSORS.items() if name == sensor.name]
                self.keep(topics, now, taken, functools.partial(self.frame, sensor, topics))

    def keep(self, topics: Any, now: float, taken: float, values: Any) -> None:
        """Count messages, and keep the values of every hundredth."""
        found = values() if self.counts[topics[0]] % EVERY == 0 else None
        for topic in topics:
            self.counts[topic] += 1
            if found is not None:
                self.kept[topic].append((ns(now), ns(taken), found[topic]))

    def frame(self, sensor: Any, topics: list[str]) -> dict[str, Any]:
        found = {name: array.numpy()[0].copy() for name, array in sensor.frames.data.items()}
        return {topic: found.get(SENSORS[topic][1]) for topic in topics}

    def state(self) -> dict[str, Any]:
        state, vehicle, parts = self.sim.state, self.vehicle, self.vehicle.parts

        def row(array: Any) -> Any:
            return array.numpy()[0].astype(np.float64)

        bodies, chassis = np.hstack([row(state.body_x), row(state.body_rot)]), parts.chassis
        axes = matrix_of(row(state.body_rot)[chassis])
        rates = [(row(getattr(state, n)) + row(getattr(state, f"{n}_low")))[chassis] for n in ("body_v", "body_omega")]
        turns = [self.sim.model.joint_dof_start[side.turn] for side in parts.sides]
        joints = dict(zip(self.sim.model.joint_names, self.sim.model.joint_dof_start, strict=False))
        return {
            "/tf": bodies, "/odom": np.concatenate([bodies[chassis], *(axes.T @ rate for rate in rates)]),
            "/joint_states": (joints, row(state.joint_x), row(state.joint_qd)), "/vehicle/commands": row(vehicle.input),
            "/vehicle/engine": [float(vehicle.engine_speed.numpy()[0]), float(vehicle.engine_torque.numpy()[0])],
            "/vehicle/wheel_states": np.concatenate([row(state.joint_x)[turns], row(state.joint_qd)[turns]]),
            "/vehicle/wheel_loads": row(vehicle.tires.load),
        }  # fmt: skip


def assert_equal(topic: str, message: Any, wanted: Any) -> None:
    """A message holds the values of the arrays, to the last bit where nothing is computed."""
    if topic == "/tf":
        found = [
            [*vector(each.transform.translation), *vector(each.transform.rotation, "xyzw")]
            for each in message.transforms
        ]
        assert np.array_equal(found, wanted)
    elif topic == "/odom":
        pose, twist = message.pose.pose, message.twist.twist
        assert np.array_equal([*vector(pose.position), *vector(pose.orientation, "xyzw")], wanted[:7])
        # three products in double precision of up to 10 m/s
        assert np.allclose([*vector(twist.linear), *vector(twist.angular)], wanted[7:], rtol=0.0, atol=1e-13)
    elif topic == "/joint_states":
        joints, places, rates = wanted
        dofs = [joints[name] for name in message.name]
        assert len(dofs) > 5
        assert np.array_equal(message.position, places[dofs])
        assert np.array_equal(message.velocity, rates[dofs])
    elif topic in ("/vehicle/commands", "/vehicle/wheel_loads"):
        assert np.array_equal(message.position or message.effort, wanted)
    elif topic in ("/vehicle/engine", "/vehicle/wheel_states"):
        assert np.array_equal([*message.position, *message.velocity, *message.effort], wanted)
    elif topic == "/imu/data":
        assert np.array_equal([*vector(message.linear_acceleration), *vector(message.angular_velocity)], wanted)
    elif topic == "/gps/fix":
        assert [message.latitude, message.longitude, message.altitude] == wanted.tolist()
    elif topic == "/gps/vel":
        assert np.array_equal(vector(message.twist.linear), wanted)
    elif topic == "/lidar/points":
        points = pixels(message, np.float32).reshape(wanted.shape)
        assert np.isfinite(points).any()
        assert np.array_equal(np.nan_to_num(points), wanted)
    elif topic == "/camera/rgb/image_raw":
        assert np.array_equal(pixels(message, np.uint8), wanted)
    else:
        assert (message.width, message.height) == (32, 18)


@pytest.mark.slow
def test_ten_minutes_read_back_equal(tmp_path: Path) -> None:
    path = tmp_path / "long.mcap"
    watched = Watched(path)
    assert watched.writer.missed == dict.fromkeys(watched.last, 0)
    counts: Counter[str] = Counter()
    compared: Counter[str] = Counter()
    with path.open("rb") as file:
        factory, last = DecoderFactory(), 0
        for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
            topic, number = channel.topic, counts[channel.topic]
            counts[topic] += 1
            assert message.log_time >= last
            last = message.log_time
            if number % EVERY:
                continue
            decode = factory.decoder_for(channel.message_encoding, schema)
            assert decode is not None
            read = decode(message.data)
            if topic == "/clock":
                assert read.clock.sec * 1_000_000_000 + read.clock.nanosec == message.log_time
            elif topic != "/tf_static":
                there, taken, wanted = watched.kept[topic][number // EVERY]
                assert message.log_time == there, topic
                assert stamp(read.transforms[0] if topic == "/tf" else read) == taken, topic
                assert_equal(topic, read, wanted)
                compared[topic] += 1
    assert counts.pop("/tf_static") == 1
    assert counts.pop("/clock") >= counts["/imu/data"]
    assert counts == watched.counts
    assert compared == {topic: len(each) for topic, each in watched.kept.items()}
    assert min(compared.values()) >= 60
    # the settling and ten minutes, from the beginning to the end
    assert counts["/tf"] == round(50.0 * (60.0 * MINUTES + 1.0)) + 1
    print(dict(counts), dict(compared), path.stat().st_size)
