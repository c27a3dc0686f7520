"""`simwarp bench`: a speed only beside a sound state, counted launches and bytes, one clear line for each mistake."""

import dataclasses
import json
import re

import numpy as np
import pytest
import warp as wp

import simwarp as sw
from simwarp import cli, scenes
from simwarp.bench import health, measure, motion, task_rows, vehicle_rows as vehicles
from simwarp.bench.timing import array_bytes, counted_launches, measure_speed
from simwarp.bench.workloads import BenchScene, bench_scenes
from simwarp.tasks import task_class
from tests.tasks.framework.graph_emulation import Emulator

RATES = ("steps_per_s", "steps_per_cpu_s", "steps_per_s_range", "steps_per_cpu_s_range", "split")


def refused(row):
    return row["valid"] is False and row["problems"] and all(row[key] is None for key in RATES)


def test_rows_have_the_keys_of_the_contract(bench, row_keys):
    code, result, err = bench("pendulum", "--worlds", "1,3")
    assert code == 0, err
    assert [row["worlds"] for row in result["rows"]] == [1, 3]
    for row in result["rows"]:
        assert set(row) >= row_keys
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
def test_a_task_is_split_into_its_parts(bench, row_keys, name, least):
    code, result, err = bench(name, "--worlds", "64")
    assert code == 0, err
    row = result["rows"][0]
    assert set(row) >= row_keys
    assert (row["scene"], result["kind"]) == (name, "task")
    assert set(row["split"]) == {"physics", "sensors", "task", "policy"}
    assert sum(row["split"].values()) == pytest.approx(1.0)
    assert row["split"]["physics"] > least if least is not None else row["split"]["physics"] == 0.0
    assert (row["bytes_per_world"] is not None) == (least is not None)


def test_a_task_whose_steps_are_a_graph_is_split_into_its_parts(monkeypatch):
    """A graph that is replayed calls no program: its physics took 0 % of a step."""
    monkeypatch.setattr(task_rows, "_SPLIT_STEPS", 4)
    run = task_rows.TaskRun("pendulum", 4, "cpu", task_class("pendulum").config_type())
    emulator = Emulator()
    run.task._captured._record, run.task._captured.reason = emulator.record, ""
    for _ in range(4):
        run.step()
    assert (emulator.recorded, emulator.replayed) == (1, 2)
    split = run.split()
    assert split["physics"] > 0.0
    assert sum(split.values()) == pytest.approx(1.0)
    assert (emulator.recorded, emulator.replayed) == (1, 6)  # the whole step is timed as it runs
    assert run.task.capture
