"""`--record FILE.mcap` of `simwarp drive`, `play`, `eval` and `view`."""

import json
import math
import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from simwarp.sensors import load_config
from simwarp.vehicle.results.channels import Run
from tests.unit.mcap.recordings import ns, of, read_by_mcap, read_by_rosbags, stamp

TURN = ("gator", "--maneuver", "constant-radius", "--duration", "0.3")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_drive_records_what_its_rows_say(folder, command):
    code, out, err = command("drive", *TURN, "--record", "a.mcap", "--csv", "a.csv", "--json", "a.json")
    assert (code, err) == (0, "")
    assert "wrote a.mcap" in out
    assert json.loads((folder / "a.json").read_text())["file"] == "a.mcap"
    assert command("drive", *TURN, "--csv", "plain.csv")[0] == 0
    assert (folder / "a.csv").read_bytes() == (folder / "plain.csv").read_bytes()  # a record changes nothing
    run = Run.read(folder / "a.csv")
    for read in (read_by_mcap(folder / "a.mcap"), read_by_rosbags(folder / "a.mcap")):
        states = of(read, "/vehicle/wheel_states")
        assert len(states) == 66  # 50 Hz, from the settling on
        wheels = ["FL", "FR", "RL", "RR"]
        for each in states:
            row = round(each.time * 1e-9 / 0.01)
            assert stamp(each.message) == each.time
            assert abs(each.time - ns(run["t_s"][row] - run["t_s"][0])) < 1000
            # nine digits are written into the rows
            wanted = [run[f"omega_{wheel}_radps"][row] for wheel in wheels]
            assert np.allclose(each.message.velocity, wanted, rtol=1e-8, atol=1e-12)
        loads = of(read, "/vehicle/wheel_loads")[-1].message
        assert np.allclose(loads.effort, [run[f"Fz_{wheel}_N"][-1] for wheel in wheels], rtol=1e-8)
        inputs = of(read, "/vehicle/commands")[-1].message
        assert list(inputs.name) == ["steering", "throttle", "braking", "clutch"]
        assert np.allclose(inputs.position[:3], [run[name][-1] for name in ("steer", "throttle", "brake")], rtol=1e-8)
        engine = of(read, "/vehicle/engine")[-1].message
        assert np.allclose(engine.velocity, run["engine_radps"][-1], rtol=1e-8)
        frames = [each.child_frame_id for each in of(read, "/tf")[-1].message.transforms]
        assert frames[0] == "base_link"
        assert len(set(frames)) == len(frames) > 5
        speed = of(read, "/odom")[-1].message.twist.twist.linear
        assert np.hypot(speed.x, speed.y) == pytest.approx(run["speed_mps"][-1], rel=0.02)  # another point of the body


def frames(name):
    """How many frames of a shipped sensor have come after 1.3 s, that of the beginning included."""
    schedule = load_config(name).schedule
    later = math.floor((1.3 - schedule.window - schedule.lag) * schedule.rate + 1e-6)
    return later + 1 + (schedule.window > 0.0)


def test_sensors_on_the_chassis_lose_no_frame(folder, command):
    sensors = "mems-imu,rtk-gps@0.1:-0.2:0.5,hood-camera,mems-imu@1:0:0,vlp-16"
    code, _, err = command("drive", *TURN, "--record", "a.mcap", "--sensors", sensors, "--csv", "a.csv")
    assert (code, err) == (0, "")
    read = read_by_mcap(folder / "a.mcap")
    counts = Counter(each.topic for each in read)
    assert counts["/mems_imu/data"] == counts["/mems_imu_2/data"] == frames("mems-imu")
    assert counts["/rtk_gps/fix"] == frames("rtk-gps")
    assert counts["/hood_camera/rgb/image_raw"] == frames("hood-camera")
    assert counts["/vlp_16/points"] == frames("vlp-16")
    times = [each.time for each in read]
    assert times == sorted(times)
    static = of(read, "/tf_static")[0].message.transforms
    places = {each.child_frame_id: each for each in static}
    offset = places["rtk_gps_link"].transform.translation
    assert (places["rtk_gps_link"].header.frame_id, offset.x, offset.y, offset.z) == ("base_link", 0.1, -0.2, 0.5)
    assert places["hood_camera_link"].transform.translation.z == 1.5
    assert places["mems_imu_link"].transform.translation.z == 0.0
    assert command("drive", *TURN, "--csv", "plain.csv")[0] == 0
    assert (folder / "a.csv").read_bytes() == (folder / "plain.csv").read_bytes()


def test_play_records_every_control_step_with_its_actions(folder, command):
    arguments = ("play", "ant", "--seconds", "0.4", "--num-envs", "2", "--worlds", "1")
    code, out, err = command(*arguments, "--record", "a.mcap", "--json", "a.json")
    assert code == 0, err
    assert "wrote a.mcap" in out
    content = json.loads((folder / "a.json").read_text())
    assert (content["file"], "video" in content) == ("a.mcap", False)
    read = read_by_mcap(folder / "a.mcap")
    commands = of(read, "/commands")
    assert len(commands[0].message.name) == len(set(commands[0].message.name)) == 8
    assert np.isfinite([each.message.position for each in commands]).all()
    steps = [each.time for each in commands]
    assert np.allclose(np.diff(steps), steps[1], atol=10)
    assert of(read, "/clock")[-1].time == pytest.approx(0.4e9, abs=1e4)
    assert command(*arguments, "--video", "a.png", "--json", "b.json")[0] == 0
    assert json.loads((folder / "b.json").read_text())["return"] == content["return"]


def test_eval_records_episode_after_episode(folder, command):
    words = (
        "eval",
        "ant",
        "--episodes",
        "3",
        "--num-envs",
        "1",
        "--task.max-episode-steps",
        "10",
        "--checkpoint",
        "zero",
    )
    code, _, err = command(*words, "--record", "a.mcap", "--json", "a.json")
    assert code == 0, err
    read = read_by_mcap(folder / "a.mcap")
    times = [each.time for each in of(read, "/clock")]
    assert times == sorted(times)
    # the baselines afterwards, in the same worlds, are not recorded; it is looked every 25 steps whether all are over
    assert len(of(read, "/commands")) == 50
    assert json.loads((folder / "a.json").read_text())["episodes"] == 3


@pytest.mark.parametrize("target", ["gator", "pendulum"])
def test_the_suffix_chooses_what_view_records(folder, command, target):
    pytest.importorskip("viser", reason="the extra viewer is not installed")
    words = ["view", target, "--record", "a.mcap", "--seconds", "0.2", "--port", "0", "--worlds", "2"]
    code, out, err = command(*words, *(["--checkpoint", "zero"] if target == "pendulum" else []))
    assert code == 0, err
    assert re.search(r"wrote a\.mcap: 0\.2 s", out)
    clock = of(read_by_mcap(folder / "a.mcap"), "/clock")
    assert (clock[0].time, clock[-1].time) == (0, pytest.approx(0.2e9, abs=2e7))
    assert Path("a.mcap").stat().st_size > 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("drive gator --record a.bag", "--record: the name must end in .mcap, got 'a.bag'; rename it"),
        ("drive gator --record /nowhere/a.mcap", "--record: cannot write '/nowhere/a.mcap': folder /nowhere does not"),
        ("drive gator --sensors vlp-16", "--sensors: are recorded, and no --record names a file for them; add"),
        ("drive gator --record a.mcap --sensors vlp-16@1:2", "a place must be x:y:z in metres, got '1:2' of 'vlp-16'"),
        ("drive gator --record a.mcap --sensors vlp-16@1:2:nan", "a place must be x:y:z in metres, got '1:2:nan'"),
        ("drive gator --record a.mcap --sensors vlp-61", "sensor 'vlp-61': not shipped (did you mean 'vlp-16'?)"),
        ("drive gator --maneuver iso-3888-1 --speeds 5,6 --record a.mcap", "--record: is of one run"),
        ("play ant --record a.mcap --video a.mp4", "--record takes the place of --video: give one of them"),
        ("play ant --record a.txt", "--record: the name must end in .mcap, got 'a.txt'; rename it"),
        ("play ant --record a.mcap --num-envs 3 --worlds 0 1", "--record shows one world, got --worlds 0 1"),
        ("play ant --record a.mcap --worlds 1", "worlds must be from 0 to 0, got 1"),
        ("eval ant --record a.mcap --grid level=0,1", "--record: records one evaluation, and --grid makes several"),
        ("eval ant --record a.mcap.gz", "--record: the name must end in .mcap, got 'a.mcap.gz'"),
        ("view ant --record a.bag", "--record: the name must end in .html, .viser or .mcap, got 'a.bag'; give it one"),
    ],
)  # fmt: skip
def test_mistakes_are_one_line(folder, command, arguments, words):
    code, _, err = command(*arguments.split())
    assert (code, err.count("\n")) == (2, 1)
    assert words in err
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("arguments", [("drive", *TURN), ("play", "ant", "--seconds", "0.1")])
def test_a_full_disk_is_one_line(folder, command, arguments):
    if not Path("/dev/full").exists():
        pytest.skip("there is no /dev/full here")
    Path("a.mcap").symlink_to("/dev/full")
    code, _, err = command(*arguments, "--record", "a.mcap")
    assert (code, err.count("\n")) == (1, 1)
    assert "cannot write 'a.mcap': No space left on device" in err
    assert "make room and repeat" in err
