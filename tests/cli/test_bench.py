"""`simwarp bench`: a speed only beside a sound state, counted launches and bytes, one clear line for each mistake."""

import dataclasses
import json
import re
import subprocess
import sys

import numpy as np
import pytest
import warp as wp

import simwarp as sw
from simwarp import cli, scenes
from simwarp.bench import health, measure, motion, workloads
from simwarp.bench import vehicle_rows as vehicles
from simwarp.bench.timing import array_bytes, counted_launches, measure_speed
from simwarp.bench.workloads import BenchScene, bench_scenes

CONTRACT = {
    "scene", "worlds", "dt", "steps_per_s", "steps_per_cpu_s", "residual", "launches_per_step", "bytes_per_world",
    "compile_s", "valid",
}  # fmt: skip
RATES = ("steps_per_s", "steps_per_cpu_s", "steps_per_s_range", "steps_per_cpu_s_range", "split")


@pytest.fixture
def bench(capfd):
    """Run the command: exit code, JSON (None without), standard error."""

    def run(*arguments):
        capfd.readouterr()
        code = cli.main(["bench", *arguments, "--seconds", "0.02", "--device", "cpu", "--json", "-"])
        out, err = capfd.readouterr()
        return code, json.loads(out) if out else None, err

    return run


@pytest.fixture
def with_scene(monkeypatch):
    """Offer one more scene under the name `test`."""

    def add(**fields):
        scene = BenchScene(name="test", summary="", **fields)
        found = bench_scenes() | {"test": scene}
        monkeypatch.setattr("simwarp.bench.subjects.bench_scenes", lambda: found)
        return scene

    return add


def refused(row):
    return row["valid"] is False and row["problems"] and all(row[key] is None for key in RATES)


def test_rows_have_the_keys_of_the_contract(bench):
    code, result, err = bench("pendulum", "--worlds", "1,3")
    assert code == 0, err
    assert [row["worlds"] for row in result["rows"]] == [1, 3]
    for row in result["rows"]:
        assert set(row) >= CONTRACT
        assert (row["scene"], row["dt"], row["valid"], row["problems"]) == ("pendulum", 0.01, True, [])
        assert row["steps_per_s"] > 0
        assert row["steps_per_cpu_s"] > 0
        assert row["compile_s"] > 0
        assert row["compile_source"] == "this process"
        assert row["launches_per_step"] == 1
        assert row["bytes_per_world"] > 0
    assert {"cpu", "cpu_cores", "python", "versions"} <= set(result["machine"])
    assert "steps/CPU-s" in err


LONG = {"heavy-on-light", "pile", "stack"}
"""Scenes that settle for seconds before they are timed."""


@pytest.mark.quick("ant", "bouncing-balls", "chain", "four-bar", "incline")
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.slow] * (name in LONG))
        for name in bench_scenes()
        if name not in ("pendulum", "linkage")
    ],
)
def test_every_scene_runs_and_is_sound(bench, name):
    code, result, err = bench(name, "--worlds", "2")
    assert code == 0, err
    assert result["rows"][0]["energy_gain"] >= 0.0


def test_the_linkage_is_the_one_of_the_contract():
    model = bench_scenes()["linkage"].build().finalize(world_count=1, device="cpu")
    assert (model.body_count, model.joint_count) == (20, 28)


def test_the_cart_pole_is_that_of_the_task_on_a_rail_with_ends():
    from simwarp.tasks import make

    mine = bench_scenes()["pendulum"].build().finalize(world_count=1, device="cpu")
    theirs = make("pendulum").simulation.model
    for name in ("body_mass", "body_inertia_b", "gravity", "joint_anchor0", "joint_anchor1"):
        np.testing.assert_array_equal(getattr(mine, name).numpy(), getattr(theirs, name).numpy(), err_msg=name)
    assert np.asarray(mine.parameters.joint_limit_lower)[0, 0] == -2.0


def test_the_ant_swings_its_legs_as_the_benchmark_says():
    run = measure.SceneRun(bench_scenes()["ant"], 3, "cpu", None)
    run.set_motion()
    run.step()
    state = run.sim.state
    q, qd, time = state.joint_q.numpy().copy(), state.joint_qd.numpy().copy(), state.world_time.numpy().copy()
    run.motion_command.launch()
    phase = 2.0 * np.pi * (1.5 * time + np.arange(3) / run.scene.variants)
    target = 0.3 * np.sin(phase[:, None] + np.arange(8))
    np.testing.assert_allclose(run.sim.control.joint_force.numpy(), 20.0 * (target - q) - qd, atol=1e-4)
    np.testing.assert_allclose(motion.swing_targets(time[:, None], 8, 3, run.scene.variants)[:, 0], target, atol=1e-12)


@pytest.mark.parametrize("name", ["ant", "hexapod", "stack"])
def test_a_settled_world_starts_the_same_whatever_the_number_of_worlds(name):
    few, many = (measure.SceneRun(bench_scenes()[name], worlds, "cpu", None) for worlds in (2, 19))
    for run in (few, many):
        run.set_motion()
    for state in ("body_x", "body_v"):
        start = getattr(many.sim.state, state).numpy()
        np.testing.assert_array_equal(getattr(few.sim.state, state).numpy(), start[:2])
        assert np.abs(start[0] - start[1]).max() > 1e-6
        np.testing.assert_array_equal(start[:3], start[16:])


def test_the_drives_of_the_hexapod_aim_as_the_benchmark_says():
    run = measure.SceneRun(bench_scenes()["hexapod"], 3, "cpu", None)
    run.set_motion()
    run.step()
    time = run.sim.state.world_time.numpy().copy()
    run.motion_command.launch()
    target = motion.swing_targets(time[:, None], 18, 3, run.scene.variants)[:, 0]
    np.testing.assert_allclose(run.sim.control.joint_target_q.numpy(), target, atol=1e-5)
    assert np.abs(run.sim.state.joint_q.numpy() - target).mean() < 0.15


def test_rows_of_scenes_with_contacts_tell_of_them(bench):
    code, result, err = bench("ant", "--worlds", "1,20")
    assert code == 0, err
    for row in result["rows"]:
        assert row["tolerance"] == 1e-3  # the residual at which the ant's speed is asked for
        assert row["residual"] <= 1e-3
        assert 2.0 <= row["contacts"] <= 5.0
        assert row["iterations"] > 0.0
        assert 0.0 <= row["penetration"] < 1e-3
        assert row["launches_per_step"] == 2
        assert row["bytes_per_world"] <= 24 * 1024
    assert "iter." in err
    code, result, _ = bench("pendulum", "--worlds", "1")
    assert code == 0
    assert result["rows"][0]["contacts"] is result["rows"][0]["penetration"] is None


# ---- what must never be told as a speed --------------------------------------------------------------------------


def test_an_enormous_step_is_refused(bench):
    code, result, err = bench("pendulum", "--worlds", "1,4", "--dt", "1.0")
    assert code == 1
    assert all(refused(row) for row in result["rows"])
    assert re.search(r"refused: simwarp, 4 worlds: .*\d", err)
    assert "refused" in err


def test_a_state_that_is_not_finite_is_refused(bench, with_scene):
    with_scene(build=scenes.double_pendulum, force=1e38)
    code, result, _ = bench("test", "--worlds", "3")
    assert code == 1
    assert refused(result["rows"][0])
    assert any("status" in problem or "finite" in problem for problem in result["rows"][0]["problems"])


def test_energy_from_nowhere_is_refused(bench, with_scene):
    # 500 N·m on two hinges of a double pendulum that holds some 40 J: all is finite and the joints hold
    with_scene(build=scenes.double_pendulum, force=500.0, horizon=0.3)
    code, result, _ = bench("test", "--worlds", "2")
    assert code == 1
    assert refused(result["rows"][0])
    assert any("energy rose" in problem for problem in result["rows"][0]["problems"])


def test_a_scene_at_rest_is_refused(bench, with_scene):
    def weightless():
        builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
        builder.add_body("body", mass=1.0, inertia=(1.0, 1.0, 1.0))
        return builder

    with_scene(build=weightless)
    code, result, _ = bench("test", "--worlds", "1")
    assert code == 1
    assert "nothing moves" in result["rows"][0]["problems"][0]


def overlapping_balls(count=2):
    builder = sw.ModelBuilder()
    builder.add_shape_plane(sw.WORLD, name="ground")
    for k in range(count):
        body = builder.add_body(f"ball{k}", mass=1.0, inertia=(0.01,) * 3, pose=sw.pose((0.15 * k, 0.0, 0.05)))
        builder.add_shape_sphere(body, radius=0.1)
    return builder


def test_deep_contacts_are_refused():
    run = measure.SceneRun(BenchScene(name="test", summary="", build=overlapping_balls), 1, "cpu", None)
    run.set_motion()
    run.step()
    assert any("m deep" in problem for problem in run.examiner.examine().problems)


def test_contacts_without_room_are_refused():
    run = measure.SceneRun(bench_scenes()["ant"], 2, "cpu", None)
    run.set_motion()
    assert run.examiner.examine().problems == ()
    run.sim.contacts.contact_overflow.assign(np.array([0, 3], np.int32))
    assert any("3 contacts of a world" in problem for problem in run.examiner.examine().problems)


def test_one_bad_world_among_many_is_enough():
    scene = bench_scenes()["pendulum"]
    run = measure.SceneRun(scene, 5, "cpu", None)
    run.set_motion()
    run.step()
    assert run.examiner.examine().problems == ()
    velocity = run.sim.state.body_v.numpy()
    velocity[3, 1] = np.nan
    run.sim.state.body_v.assign(velocity)
    assert run.examiner.examine().problems != ()


def test_an_explosion_that_only_the_timing_reaches_is_refused(monkeypatch):
    # The rehearsal is sound; a later check, between the timed parts, is not
    examine, calls = health.MotionHealthCheck.examine, []

    def later(self):
        calls.append(self)
        found = examine(self)
        return dataclasses.replace(found, problems=("exploded",)) if len(calls) == 3 else found

    monkeypatch.setattr(health.MotionHealthCheck, "examine", later)
    row = measure.measure_scene(bench_scenes()["pendulum"], 1, "cpu", None, 0.02)
    assert len(calls) > 3
    assert (row.valid, row.problems) == (False, ("exploded",))
    assert row.steps_per_s is None


def test_a_residual_that_is_not_a_number_stays_one():
    sound = health.Health((), 1e-6, 1e-6, 0.0, 1.0)
    broken = health.Health(("bad",), float("nan"), 1e-6, 0.0, 1.0)
    for worst in (sound.worse(broken), broken.worse(sound)):
        assert np.isnan(worst.residual)
        assert worst.problems == ("bad",)


# ---- vehicles ----------------------------------------------------------------------------------------------------


def test_a_vehicle_is_timed_where_it_moves(capfd):
    code = cli.main(["bench", "gator", "--worlds", "1,32", "--seconds", "0.05", "--json", "-"])
    content = json.loads(capfd.readouterr().out)
    assert code == 0
    assert (content["kind"], content["scene"]) == ("vehicle", "gator")
    assert [row["worlds"] for row in content["rows"]] == [1, 32]
    for row in content["rows"]:
        assert row["valid"]
        assert row["steps_per_cpu_s"] > 0
        assert row["position_error"] < vehicles.POSITION_ERROR
        # script, inputs, tires, step
        assert row["launches_per_step"] == 5  # driver, vehicle, tires, step, motion


def test_worlds_of_a_vehicle_stand_at_sixteen_places_of_the_run():
    few, many = (vehicles.VehicleRun("gator", worlds, "cpu", None) for worlds in (3, 20))
    for run in (few, many):
        run.set_motion()
    times = many.sim.time.numpy()
    start = many.setup.maneuver.start
    assert sorted(np.round(times[:16] - start, 2)) == pytest.approx(np.arange(16) * vehicles.HORIZON, abs=0.01)
    # world 0 is the same whatever the number of worlds; brakes are released in all of them
    assert times[0] == few.sim.time.numpy()[0] == times[16]
    for run in (few, many):
        for _ in range(5):
            run.step()
    assert np.array_equal(few.sim.state.body_x.numpy(), many.sim.state.body_x.numpy()[:3])
    inputs = many.setup.vehicle.input.numpy()
    assert inputs[:, 2].max() < 0.2
    assert inputs[3, 0] == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("harm", "words"),
    [
        (lambda run: run.sim.state.body_v.fill_(wp.vec3(wp.nan)), "not finite"),
        (lambda run: run.setup.vehicle.tires.load.fill_(1.0), "of the weight"),
        (lambda run: run.sim.state.body_v.fill_(wp.vec3(9.0, 0.0, 0.0)), "are held"),
        (lambda run: run.sim.state.body_v.zero_(), "nothing moves"),
        (lambda run: run.sim.diagnostics.position_error.fill_(0.1), "apart"),
        (lambda run: run.sim.diagnostics.row_residual.fill_(0.1), "row residual"),
    ],
)
def test_an_unsound_vehicle_is_refused(harm, words):
    run = vehicles.VehicleRun("gator", 16, "cpu", None)
    run.set_motion()
    for _ in range(100):
        run.step()
    assert run.examiner.examine().problems == ()
    harm(run)
    assert any(words in problem for problem in run.examiner.examine().problems)


# ---- what is counted ---------------------------------------------------------------------------------------------


def test_launches_are_counted_not_assumed():
    sim = sw.Simulation(scenes.pendulum().finalize(world_count=2, device="cpu"), dt=1e-3, substeps=3)
    with counted_launches() as count:
        sim.step()
        assert count.total == 3
        sim.reset()
        assert count.total == 4
    before = wp.launch, wp.Launch.launch
    with pytest.raises(ZeroDivisionError), counted_launches():
        raise ZeroDivisionError
    assert (wp.launch, wp.Launch.launch) == before


def test_bytes_per_world_is_what_one_more_world_takes(bench):
    scene = bench_scenes()["linkage"]
    sizes = [array_bytes(measure.SceneRun(scene, worlds, "cpu", None).sim) for worlds in (3, 4, 8)]
    assert sizes[2] - sizes[1] == 4 * (sizes[1] - sizes[0])
    sim = measure.SceneRun(scene, 4, "cpu", None).sim
    state = sum(getattr(sim.state, name).capacity for name in sim.state.NAMES) / 4
    # the state twice (the initial one is kept), and the control and the reports besides
    assert 2 * state < sizes[1] - sizes[0] < 4 * state


def test_the_clock_runs_for_stepping_only():
    class Slow:
        horizon_steps = 4
        steps = restarts = 0

        def step(self):
            self.steps += 1
            sum(range(2000))

        def restart(self):
            self.restarts += 1
            self.since = 0

        def wait(self):
            pass

    run, checks = Slow(), []
    speed = measure_speed(run, 10, 0.02, lambda: checks.append(1))
    assert 0 < speed.steps <= 10 * run.steps
    assert speed.steps % 10 == 0
    assert len(checks) >= 5
    assert run.restarts >= len(checks)
    rates = [wall for wall, _ in speed.repeats]
    assert min(rates) <= speed.steps_per_s <= max(rates)


# ---- tasks, peers, cold start ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "least"), [("pendulum-task", 0.0), ("ant-task", 0.2), ("fast", None)])
def test_a_task_is_split_into_its_parts(bench, name, least):
    code, result, err = bench(name, "--worlds", "64")
    assert code == 0, err
    row = result["rows"][0]
    assert set(row) >= CONTRACT
    assert (row["scene"], result["kind"]) == (name, "task")
    assert set(row["split"]) == {"physics", "sensors", "task", "policy"}
    assert sum(row["split"].values()) == pytest.approx(1.0)
    assert row["split"]["physics"] > least if least is not None else row["split"]["physics"] == 0.0
    assert (row["bytes_per_world"] is not None) == (least is not None)


def test_mujoco_stands_beside_the_cart_pole_and_moves_alike(bench):
    pytest.importorskip("mujoco")
    from simwarp.bench.peers import AGREEMENT, differs_by

    # both are first-order in the step, 1 ms, which the falling pole amplifies some twenty times in a second
    assert differs_by(bench_scenes()["pendulum"]) < 0.1 * AGREEMENT
    code, result, err = bench("pendulum", "--worlds", "1,5", "--peers")
    assert code == 0, err
    assert [row["worlds"] for row in result["peers"]] == [1, 5]
    assert all(set(row) >= CONTRACT and row["valid"] for row in result["peers"])
    assert all(row["engine"].startswith("mujoco ") for row in result["peers"])
    assert any("newton" in note for note in result["notes"])


def test_a_peer_with_another_model_is_refused(monkeypatch):
    pytest.importorskip("mujoco")
    from simwarp.bench import peers

    monkeypatch.setattr(peers, "POLE_MASS", 1.0)
    row = peers.measure_mujoco(bench_scenes()["pendulum"], 1, None, 0.02)
    assert not row.valid
    assert row.steps_per_s is None
    assert "not the same motion" in row.problems[0]


def test_the_ant_of_mujoco_is_ours_in_the_air():
    pytest.importorskip("mujoco")
    from simwarp.bench.contact_peers import MuJoCoRun, start_of

    # without ground nothing but the model and its motors can differ
    scene = dataclasses.replace(bench_scenes()["ant"], build=lambda: scenes.ant(ground=False), settle=0.0)
    run = measure.SceneRun(scene, 3, "cpu", 1e-3)
    run.set_motion()
    theirs = MuJoCoRun(scene, start_of(run), run.dt, 500, True)
    theirs.model.geom_contype[:] = 0
    theirs.model.geom_conaffinity[:] = 0
    for _ in range(500):
        run.single_step()
    for _ in range(theirs.horizon_steps):
        theirs.step()
    mine = start_of(run)
    np.testing.assert_allclose(theirs.now[:, 1:16], mine.qpos, atol=2e-3)
    np.testing.assert_allclose(theirs.now[:, 16:], mine.qvel, atol=0.05)


@pytest.mark.parametrize("name", ["ant", pytest.param("stack", marks=pytest.mark.slow)])
def test_mujoco_stands_beside_scenes_with_contacts(bench, name):
    pytest.importorskip("mujoco")
    code, result, err = bench(name, "--worlds", "2", "--peers")
    assert code == 0, err
    row = result["peers"][0]
    assert set(row) >= CONTRACT
    assert row["engine"].startswith("mujoco ")
    assert row["valid"]
    assert row["residual"] is None
    assert row["contacts"] > 2.0


def test_an_ant_with_weak_motors_is_no_peer(monkeypatch):
    pytest.importorskip("mujoco")
    from simwarp.bench import contact_peers

    text = contact_peers.model_text("ant").replace('kp="20"', 'kp="4"')
    monkeypatch.setattr(contact_peers, "model_text", lambda name: text)
    contact_peers.their_motion.cache_clear()
    row = contact_peers.measure_peer("mujoco", bench_scenes()["ant"], 1, None, 0.02)
    contact_peers.their_motion.cache_clear()
    assert not row.valid
    assert row.steps_per_s is None
    assert "mean height" in row.problems[0]


@pytest.mark.parametrize("module", ["mujoco_warp", "newton"])
def test_the_other_engines_stand_beside_the_ant_where_they_are_installed(module):
    pytest.importorskip(module)
    from simwarp.bench import contact_peers

    row = contact_peers.measure_peer(module, bench_scenes()["ant"], 2, None, 0.02)
    assert row.valid, row.problems


def test_scenes_without_a_peer_say_so(bench):
    code, result, err = bench("four-bar", "--worlds", "1", "--peers")
    assert code == 0
    assert result["peers"] == []
    assert "no other engine has a model of 'four-bar'" in err


@pytest.mark.slow
def test_cold_start_is_measured_in_a_new_process(bench):
    code, result, _ = bench("simple-pendulum", "--worlds", "1", "--compile")
    assert code == 0
    row = result["rows"][0]
    assert row["compile_source"] == "cold process"
    assert row["compile_s"] > 3.0 * row["compile_warm_s"] > 0.0
    assert row["compile_cpu_s"] > row["compile_warm_s"]


@pytest.mark.slow
def test_the_last_of_many_models_compiles_nothing(tmp_path):
    file = tmp_path / "models.json"
    done = subprocess.run(
        [sys.executable, "benchmarks/hundred_models.py", "--models", "6", "--max-bodies", "3", "--json", str(file)],
        capture_output=True, text=True, timeout=600,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    result = json.loads(file.read_text(encoding="utf-8"))
    assert result["rows"][0]["compiled"] >= 1
    assert result["last_compiled"] == 0


@pytest.mark.slow
def test_the_script_writes_tables_and_what_the_time_goes_to(tmp_path):
    done = subprocess.run(
        [
            sys.executable, "benchmarks/contact_peers.py", "--scenes", "ant", "--seconds", "0.02", "--no-peers",
            "--out", str(tmp_path),
        ],
        capture_output=True, text=True, timeout=600,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    result = json.loads((tmp_path / "ant.json").read_text(encoding="utf-8"))
    assert [row["worlds"] for row in result["rows"]] == [1, 256, 1024, 4096]
    parts = result["breakdown_us"]
    assert all(parts[key] > 0.0 for key in ("whole", "motion", "collision", "free_motion", "contact_rows", "solve"))


# ---- wrong input -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "which scene?"),
        (["pendulm"], "did you mean pendulum"),
        (["fast-taks"], "did you mean"),
        (["hexapood"], "did you mean hexapod"),
        (["stak"], "did you mean stack"),
        (["camra"], "did you mean camera"),
        (["pendulum", "--worlds", "0"], "at least 1"),
        (["pendulum", "--worlds", "-4"], "at least 1"),
        (["pendulum", "--worlds", "1,,2"], "whole numbers"),
        (["pendulum", "--worlds", "1e3"], "whole numbers"),
        (["pendulum", "--worlds", "99999999999"], "use fewer worlds"),
        (["pendulum", "--device", "tpu"], "device 'tpu' is not available"),
        (["pendulum", "--dt", "0"], "dt must be a positive number"),
        (["pendulum", "--dt", "nan"], "dt must be a finite number"),
        (["pendulum", "--seconds", "-1"], "seconds must be a positive number"),
        (["pendulum", "--world", "1"], "did you mean --worlds?"),
        (["pendulum", "--json", "/no/such/folder/x.json"], "does not exist"),
    ],
)
def test_one_line_and_exit_code_2(capfd, arguments, words):
    assert cli.main(["bench", *arguments]) == 2
    out, err = capfd.readouterr()
    assert out == ""
    assert err.startswith("simwarp: ")
    assert err.count("\n") == 1
    assert words in err


def test_help_lists_the_scenes(capfd):
    assert cli.main(["bench", "--help"]) == 0
    out = capfd.readouterr().out
    assert all(name in out for name in ("linkage", "pendulum", "pendulum-task", "fast"))


@pytest.mark.quick("camera-flat", "lidar")
@pytest.mark.parametrize("name", [name for name in workloads.SENSOR_SCENES if name != "rays"])
def test_every_sensor_is_timed_on_frames_that_show_something(bench, name):
    code, result, err = bench(name, "--worlds", "2")
    assert code == 0, err
    (row,) = result["rows"]
    assert set(row) >= CONTRACT
    assert (result["kind"], row["scene"], row["valid"]) == ("sensor", name, True)
    assert row["bytes_per_world"] > 0


@pytest.mark.slow
def test_rays_are_timed_beside_embree_on_the_same_hits(bench):
    pytest.importorskip("embreex")
    code, result, err = bench("rays", "--worlds", "2", "--peers")
    assert code == 0, err
    assert [row["scene"] for row in result["rows"]] == ["rays-10k", "rays-200k"]
    assert [(row["engine"], row["valid"]) for row in result["peers"]] == [("embree", True)] * 2
    # geometry is shared: a world has a place in it, no copy (a mesh of 10 k triangles takes half a megabyte)
    assert all(row["bytes_per_world"] < 100_000 for row in result["rows"])
    assert result["rows"][1]["bytes_shared"] > 5 * result["rows"][0]["bytes_shared"]
    assert "rays-200k" in err


def test_rows_of_threads(bench):
    code, result, err = bench("pendulum", "--worlds", "1,12", "--threads", "1,2", "--peers")
    assert code == 0, err
    assert [(row["worlds"], row["threads"]) for row in result["rows"]] == [(1, 1), (1, 2), (12, 1), (12, 2)]
    assert [(row["worlds"], row["threads"]) for row in result["peers"]] == [(1, 1), (1, 2), (12, 1), (12, 2)]
    # the motion is the same, so are its residuals; launches are counted over all worlds
    assert result["rows"][2]["residual"] == result["rows"][3]["residual"]
    assert {row["launches_per_step"] for row in result["rows"]} == {1}


def test_by_default_one_thread_and_all(bench, monkeypatch):
    monkeypatch.setenv("SIMWARP_THREADS", "3")
    _, result, err = bench("pendulum", "--worlds", "12")
    assert [row["threads"] for row in result["rows"]] == [1, 3]
    assert "threads" in err


@pytest.mark.parametrize(("text", "message"), [
    ("0", "threads must each be at least 1, got '0'"), ("two", "threads must be whole numbers with commas"),
    ("4096", "threads must each be at most 1024, got '4096'"),
])  # fmt: skip
def test_threads_that_are_none(bench, text, message):
    code, _, err = bench("pendulum", "--threads", text)
    assert code == 2
    assert message in err
