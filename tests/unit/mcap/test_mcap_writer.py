"""Recordings of the state: values, rates, resets, and files of processes that were killed."""

from __future__ import annotations

import importlib
import importlib.util
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader
from mcap_ros2.decoder import DecoderFactory
from rosbags.rosbag2 import Reader

import simwarp as sw
from simwarp import sensors as s
from simwarp.core.files import OutputError
from simwarp.core.rotation import matrix_of
from simwarp.mcap import mcap_file
from tests.unit.mcap.recordings import ns, of, read_by_mcap, read_by_rosbags, stamp

DT = 0.01


def simulation(sensors: Any = lambda model: [], **options: Any) -> sw.Simulation:
    """A free body with a hinged arm, and a slide, in three worlds."""
    builder = sw.ModelBuilder()
    hull = builder.add_body("hull", mass=2.0, inertia=(0.2, 0.3, 0.4), pose=sw.pose((0, 0, 5.0)), velocity=(1, 2, 3))
    arm = builder.add_body("arm", mass=1.0, inertia=(0.1, 0.1, 0.1), pose=sw.pose((0.5, 0, 5.0)))
    box = builder.add_body("map", mass=1.0, inertia=(0.1, 0.1, 0.1))  # a name that a frame of the tree has
    builder.add_joint_revolute("hinge", hull, arm, anchor=(0.2, 0.0, 5.0), axis=(0.0, 1.0, 0.0))
    builder.add_joint_prismatic("slide", sw.WORLD, box, axis=(1.0, 0.0, 0.0))
    model = builder.finalize(3, "cpu")
    return sw.Simulation(model, DT, sensors=sensors(model), threads=1, **options)


def test_the_state_reads_back_equal(tmp_path: Path) -> None:
    sim = simulation()
    omega = np.zeros((3, 3, 3), np.float32)
    omega[:, 0] = (0.3, -0.7, 0.2)
    sim.state.body_omega.assign(omega)
    sim.control.joint_force.assign(np.tile(np.array([0.25, -3.0], np.float32), (3, 1)))
    kept = []

    def keep() -> None:
        names = ("body_x", "body_rot", "body_v", "body_v_low", "body_omega", "body_omega_low", "joint_x", "joint_qd")
        kept.append({name: getattr(sim.state, name).numpy()[2].astype(np.float64) for name in names})

    path = tmp_path / "run.mcap"
    with sw.mcap.Writer(path, sim, world=2, rate=1.0 / DT) as writer:
        keep()
        for _ in range(20):
            sim.step()
            writer.add()
            keep()
    for read in (read_by_mcap(path), read_by_rosbags(path)):
        rows = (of(read, topic) for topic in ("/clock", "/tf", "/odom", "/joint_states", "/joint_commands"))
        for step, (clock, tf, odom, joints, commands, wanted) in enumerate(zip(*rows, kept, strict=True)):
            time = tf.time
            assert abs(time - ns(step * DT)) <= 10  # sums of a step of single precision
            assert {each.time for each in (clock, odom, joints, commands)} == {time}
            assert {stamp(each.message) for each in (odom, joints, commands)} == {time}
            assert clock.message.clock.sec * 1_000_000_000 + clock.message.clock.nanosec == time
            assert [each.child_frame_id for each in tf.message.transforms] == ["base_link", "arm", "map_2"]
            for body, each in enumerate(tf.message.transforms):
                place, turn = each.transform.translation, each.transform.rotation
                assert each.header.frame_id == "odom"
                assert np.array_equal([place.x, place.y, place.z], wanted["body_x"][body])
                assert np.array_equal([turn.x, turn.y, turn.z, turn.w], wanted["body_rot"][body])
            message = odom.message
            assert (message.header.frame_id, message.child_frame_id) == ("odom", "base_link")
            place, twist = message.pose.pose.position, message.twist.twist
            assert np.array_equal([place.x, place.y, place.z], wanted["body_x"][0])
            axes = matrix_of(wanted["body_rot"][0])
            for part, name in ((twist.linear, "body_v"), (twist.angular, "body_omega")):
                rate = wanted[name][0] + wanted[f"{name}_low"][0]
                # a rotation in double precision
                assert np.allclose(axes @ [part.x, part.y, part.z], rate, rtol=0.0, atol=1e-14)
            assert joints.message.name == ["hinge", "slide"]
            assert np.array_equal(joints.message.position, wanted["joint_x"])
            assert np.array_equal(joints.message.velocity, wanted["joint_qd"])
            assert np.array_equal(commands.message.effort, [0.25, -3.0])


def test_a_recording_changes_nothing(tmp_path: Path) -> None:
    plain, watched = simulation(), simulation()
    with sw.mcap.Writer(tmp_path / "run.mcap", watched) as writer:
        for _ in range(10):
            plain.step()
            watched.step()
            writer.add()
    for name in plain.state.NAMES:
        assert np.array_equal(getattr(plain.state, name).numpy(), getattr(watched.state, name).numpy()), name


@pytest.mark.parametrize(("rate", "steps"), [(50.0, 2), (10.0, 10), (33.0, 3), (1000.0, 1)])
def test_the_state_comes_at_its_rate(tmp_path: Path, rate: float, steps: int) -> None:
    sim = simulation()
    with sw.mcap.Writer(tmp_path / "run.mcap", sim, rate=rate) as writer:
        for _ in range(30):
            sim.step()
            writer.add()
            writer.add()  # nothing is new
    found = [round(each.time / ns(DT)) for each in of(read_by_mcap(tmp_path / "run.mcap"), "/odom")]
    assert found == [*range(0, 31, steps)]


def messages(path: Path) -> list[tuple[str, int, bytes]]:
    """All messages as they lie in the file."""
    with path.open("rb") as file:
        found = NonSeekingReader(file).iter_messages(log_time_order=False)
        return [(channel.topic, message.log_time, message.data) for _, channel, message in found]


@pytest.mark.parametrize("substeps", [1, 3])
@pytest.mark.parametrize("rate", [50.0, 33.0, 4.0])
def test_steps_at_once_record_what_single_steps_do(tmp_path: Path, rate: float, substeps: int) -> None:
    """Frames with windows and lags, of schedules that share no period, and of phases that are drawn."""

    def imus(model: Any) -> list[Any]:
        schedules = [
            s.Schedule(rate=20.0), s.Schedule(rate=12.5, window=0.03, lag=0.02),
            s.Schedule(rate=5.0, lag=0.07, phase="random"),
        ]  # fmt: skip
        return [
            s.Imu(model, s.Mount("hull"), s.ImuConfig(schedule=each), name=f"imu {number}")
            for number, each in enumerate(schedules)
        ]

    for sensors in (imus, lambda model: []):
        blocks = []
        for name in ("single", "blocks"):
            sim = simulation(sensors, substeps=substeps)
            with sw.mcap.Writer(tmp_path / f"{name}.mcap", sim, world=1, rate=rate) as writer:
                done = 0
                while done < 120:
                    steps = min(writer.steps_to_next() if name == "blocks" else 1, 120 - done)
                    sim.step(steps)
                    writer.add()
                    done += steps
                    blocks += [steps] if name == "blocks" else []
                assert not any(writer.missed.values())
        assert messages(tmp_path / "blocks.mcap") == messages(tmp_path / "single.mcap")
        assert max(blocks) > 1
        assert len(blocks) < 90


def test_messages_larger_than_a_chunk_are_read_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = []
    for name, chunk in (("usual", mcap_file.CHUNK), ("small", 100)):
        monkeypatch.setattr(mcap_file, "CHUNK", chunk)
        monkeypatch.setattr(mcap_file, "ROOM", 10)
        sim = simulation()
        with sw.mcap.Writer(tmp_path / f"{name}.mcap", sim) as writer:
            for _ in range(20):
                sim.step()
                writer.add()
        wanted.append(messages(tmp_path / f"{name}.mcap"))
    assert len(wanted[0]) > 50
    assert wanted[0] == wanted[1]


def test_time_goes_on_where_a_world_is_reset(tmp_path: Path) -> None:
    def imu(model: Any) -> list[Any]:
        return [s.Imu(model, s.Mount("hull"), s.ImuConfig(schedule=s.Schedule(rate=50.0, lag=0.01)))]

    sim = simulation(imu)
    with sw.mcap.Writer(tmp_path / "run.mcap", sim, world=1, rate=1.0 / DT) as writer:
        for step in range(12):
            sim.step()
            if step == 5:
                sim.reset(np.array([False, True, False]))
            if step == 8:
                sim.reset(np.array([True, False, False]))  # another world
            writer.add()
    read = read_by_mcap(tmp_path / "run.mcap")
    ticks = [round(each.time / ns(DT)) for each in of(read, "/odom")]
    assert ticks == [*range(13)]
    heights = [each.message.pose.pose.position.z for each in of(read, "/odom")]
    assert heights[6] == heights[0] == 5.0
    late = [(round(each.time / ns(DT)), round(stamp(each.message) / ns(DT))) for each in of(read, "/imu/data")]
    assert late == [(0, 0), (3, 2), (5, 4), (6, 6), (9, 8), (11, 10)]
    assert writer.missed == {"imu": 0}
    assert writer.elapsed == pytest.approx(12 * DT, abs=1e-6)


def test_frames_that_nobody_saw_are_counted(tmp_path: Path) -> None:
    def imu(model: Any) -> list[Any]:
        return [s.Imu(model, s.Mount("hull"), s.ImuConfig(schedule=s.Schedule(rate=100.0)))]

    sim = simulation(imu)
    with sw.mcap.Writer(tmp_path / "run.mcap", sim) as writer:
        for _ in range(5):
            sim.step(4)
            writer.add()
    assert writer.missed == {"imu": 15}


def test_a_sensor_without_a_message_is_left_out(tmp_path: Path) -> None:
    class Own(sw.Sensor):
        name = "own"
        data: Any = None
        timestamp: Any = None
        valid: Any = None

    sim = simulation(lambda model: [Own()])
    with sw.mcap.Writer(tmp_path / "run.mcap", sim) as writer:
        assert writer.left_out == ["own"]


def test_commands_have_the_names_that_they_had(tmp_path: Path) -> None:
    sim = simulation()
    with sw.mcap.Writer(tmp_path / "run.mcap", sim) as writer:
        sim.step()
        writer.add({"steering": 0.25, "throttle": -1.0 / 3.0})
        with pytest.raises(sw.ModelError, match="commands must have the names steering, throttle in every call, got"):
            writer.add({"steering": 0.25})
    (found,) = of(read_by_mcap(tmp_path / "run.mcap"), "/commands")
    assert (found.message.name, list(found.message.position)) == (["steering", "throttle"], [0.25, -1.0 / 3.0])


@pytest.mark.parametrize(
    ("base", "frames"), [("arm", ["hull", "base_link", "map_2"]), (0, ["base_link", "arm", "map_2"])]
)
def test_any_body_may_be_the_base(tmp_path: Path, base: Any, frames: list[str]) -> None:
    sim = simulation()
    sw.mcap.Writer(tmp_path / "run.mcap", sim, base=base).close()
    read = read_by_mcap(tmp_path / "run.mcap")
    assert [each.child_frame_id for each in of(read, "/tf")[0].message.transforms] == frames
    place = of(read, "/odom")[0].message.pose.pose.position
    body = frames.index("base_link")
    assert np.array_equal([place.x, place.y, place.z], sim.state.body_x.numpy()[0, body])


@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
def test_compressed_chunks_hold_the_same(tmp_path: Path, compression: str) -> None:
    sim = simulation()
    with sw.mcap.Writer(tmp_path / "run.mcap", sim, compression=compression, rate=100.0) as writer:
        for _ in range(5):
            sim.step()
            writer.add()
    counts = Counter(each.topic for each in read_by_mcap(tmp_path / "run.mcap"))
    assert counts["/tf"] == counts["/clock"] == 6


def test_static_transforms_are_kept_for_who_comes_later(tmp_path: Path) -> None:
    sw.mcap.Writer(tmp_path / "run.mcap", simulation()).close()
    with Reader(tmp_path / "run.mcap") as reader:
        for connection in reader.connections:
            extension: Any = connection.ext
            latched = [qos.durability.name for qos in extension.offered_qos_profiles]
            assert latched == (["TRANSIENT_LOCAL"] if connection.topic == "/tf_static" else [])


def test_a_mount_that_moves_is_told_again(tmp_path: Path) -> None:
    def imu(model: Any) -> list[Any]:
        return [s.Imu(model, s.Mount("hull"), s.ImuConfig(schedule=s.Schedule(rate=100.0)))]

    sim = simulation(imu)
    with sw.mcap.Writer(tmp_path / "run.mcap", sim, rate=100.0) as writer:
        for step in range(4):
            if step == 2:
                moving: Any = sim.sensors[0]
                moving.mount.position.assign([(0.1, 0.2, 0.3)])
            sim.step()
            writer.add()
    found = of(read_by_mcap(tmp_path / "run.mcap"), "/tf_static")
    places = [each.message.transforms[1].transform.translation for each in found]
    assert [(place.x, place.y, place.z) for place in places] == [(0.0, 0.0, 0.0), (0.1, 0.2, 0.3)]
    assert round(found[1].time / ns(DT)) == 3


# ---- what goes wrong -------------------------------------------------------------------------------------------------

KILLED = """
import os, signal, sys
from pathlib import Path
sys.path.insert(0, {root!r})
import simwarp.mcap.mcap_file as file
from tests.unit.mcap.test_mcap_writer import DT, simulation
import simwarp as sw
file.LONGEST_CHUNK = {longest}
sim = simulation()
writer = sw.mcap.Writer("run.mcap", sim, rate=1.0 / DT)
for step in range(30):
    sim.step()
    writer.add()
    if step == 19 and {longest} > 0.0:
        writer.flush()
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.parametrize(("longest", "states"), [(1e9, 21), (0.0, 31)])
def test_a_killed_process_leaves_its_finished_chunks(tmp_path: Path, longest: float, states: int) -> None:
    root = str(Path(__file__).parents[3])
    program = KILLED.format(root=root, longest=longest)
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert done.returncode == -signal.SIGKILL, done.stderr
    counts: Counter[str] = Counter()
    with (tmp_path / "run.mcap").open("rb") as file:
        reader = NonSeekingReader(file, decoder_factories=[DecoderFactory()])
        try:
            for _, channel, _, _ in reader.iter_decoded_messages(log_time_order=False):
                counts[channel.topic] += 1
        except EndOfFile:
            pass  # the file has no end
    assert counts["/odom"] == counts["/tf"] == states


def test_a_full_disk_is_one_line(tmp_path: Path) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("there is no /dev/full here")
    (tmp_path / "run.mcap").symlink_to("/dev/full")
    sim = simulation()
    writer = sw.mcap.Writer(tmp_path / "run.mcap", sim)
    with pytest.raises(OutputError, match=r"run.mcap': No space left on device.*make room and repeat") as found:
        writer.flush()
    assert "\n" not in str(found.value)
    writer.close()  # there is nothing more to say
    with pytest.raises(sw.ModelError, match="is closed and takes no more; make another Writer"):
        writer.add()


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "world": ({"world": 3}, "Writer: world must be an integer >= 0 and <= 2, got 3; count from 0"),
    "negative world": ({"world": -1}, "Writer: world must be an integer >= 0, got -1; count from 0"),
    "rate": ({"rate": 0.0}, r"Writer: rate must be positive, got 0.0; give messages per second \[Hz\]"),
    "base": ({"base": "hul"}, "model has no body 'hul'; did you mean 'hull'?"),
    "body": ({"base": 3}, "Writer: base must be an index below 3 or a name, got 3; take what add_body returned"),
    "compression": ({"compression": "gzip"}, "Writer: compression must be lz4, zstd or none, got 'gzip'; take lz4"),
}


@pytest.mark.parametrize("case", WRONG)
def test_mistakes_are_one_line_and_leave_no_file(tmp_path: Path, case: str) -> None:
    options, message = WRONG[case]
    with pytest.raises(sw.ModelError, match=message):
        sw.mcap.Writer(tmp_path / "run.mcap", simulation(), **options)
    assert not [*tmp_path.iterdir()]


def test_other_kinds_of_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(sw.ModelError, match=r"Writer: the name must end in .mcap, got '.*run.bag'; rename it"):
        sw.mcap.Writer(tmp_path / "run.bag", simulation())


@pytest.mark.parametrize("name", ["mcap", "rosbags"])
def test_a_missing_extra_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda word, *rest: None if word == name else find(word, *rest))
    message = rf"recording: must have module '{name}', got none; pip install 'simwarp\[mcap\]'"
    with pytest.raises(sw.ModelError, match=message):
        sw.mcap.Writer(tmp_path / "run.mcap", simulation())
    module = {"mcap": "mcap.mcap_file", "rosbags": "ros2.ros_messages"}[name]
    monkeypatch.setitem(sys.modules, name, None)
    for inner in [each for each in sys.modules if each.startswith(f"{name}.")]:
        monkeypatch.setitem(sys.modules, inner, None)
    monkeypatch.delitem(sys.modules, f"simwarp.{module}")
    with pytest.raises(sw.ModelError, match=r"pip install 'simwarp\[mcap\]'"):
        importlib.import_module(f"simwarp.{module}")
