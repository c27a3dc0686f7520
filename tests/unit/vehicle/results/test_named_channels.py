"""Channels chosen by name, each against a second computation from the arrays of the Simulation."""

import numpy as np
import pytest

import simwarp as sw
from simwarp.model.builder import ModelBuilder
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.results.channel_samples import wheel_names
from simwarp.vehicle.results.channels import Recorder, Run
from simwarp.vehicle.results.chassis_motion import matrices
from simwarp.vehicle.spec.vehicle_files import load_vehicle
from simwarp.vehicle.spec.vehicle_spec import SpecError
from simwarp.vehicle.vehicle import VEHICLE_SOLVER, Vehicle, per_world

SPEED, STEPS = 8.0, 500


@pytest.fixture(scope="module")
def left_turn():
    """A HMMWV half a second into a left turn, with all its channels sampled twice, 10 ms apart."""
    builder = ModelBuilder()
    parts = add_vehicle(builder, load_vehicle("hmmwv"), speed=SPEED)
    model = builder.finalize(1, "cpu", per_world=per_world())
    car = Vehicle(parts, model)
    car.input.assign(np.array([[0.4, 0.0, 0.0, 0.0]], np.float32))
    sim = sw.Simulation(model, 1.0e-3, elements=[car], solver=VEHICLE_SOLVER, joint_reactions=True)
    recorder = Recorder(sim, car, channels=["*", "reaction:axle0.left.spring*", "reaction:axle1.right.spring*"])
    for step in range(1, STEPS + 1):
        sim.step()
        if step >= STEPS - 10 and step % 10 == 0:
            recorder.sample()
    return sim, car, recorder


def last(recorder, name):
    return float(recorder.column(name)[-1, 0])


def test_signs_of_a_left_turn(left_turn):
    _, _, recorder = left_turn
    for name in ("steer", "yawrate_radps", "ay_mps2", "steerangle_FL_rad", "Fy_FL_N", "Fy_RR_N"):
        assert last(recorder, name) > 0.0, name
    for wheel in wheel_names(2):
        assert last(recorder, f"spin_{wheel}_radps") == last(recorder, f"omega_{wheel}_radps") > 0.0
    assert last(recorder, "roll_rad") > 0.0
    # a front wheel that is turned to the left of its way drifts to the right
    assert last(recorder, "slipangle_FL_rad") < 0.0


def test_forces_in_wheel_axes_are_those_of_the_world_turned(left_turn):
    sim, car, recorder = left_turn
    for wheel, name in enumerate(wheel_names(2)):
        force = car.tires.force_w.numpy()[0, wheel].astype(float)
        axle = matrices(sim.state.body_rot.numpy()[0, car.parts.sides[wheel].spindle].astype(float))[:, 1]
        heading = np.arctan2(-axle[0], axle[1])
        x = np.cos(heading) * force[0] + np.sin(heading) * force[1]
        y = -np.sin(heading) * force[0] + np.cos(heading) * force[1]
        got = [last(recorder, f"F{axis}_{name}_N") for axis in "xyz"]
        # both in double precision from the same float32 arrays
        assert got == pytest.approx([x, y, force[2]], abs=1e-6 * float(np.linalg.norm(force)))
        # no tire transmits a moment about its W axes that is large beside its load times its radius
        assert abs(last(recorder, f"Mx_{name}_Nm")) < 0.2 * force[2]


def test_sideslip_and_accelerations_follow_from_velocities(left_turn):
    sim, car, recorder = left_turn
    velocity = sim.state.body_v.numpy()[0, car.parts.chassis].astype(float)
    yaw = last(recorder, "yaw_rad")
    expected = np.arctan2(velocity[1], velocity[0]) - yaw
    assert last(recorder, "sideslip_rad") == pytest.approx(expected, abs=1e-6)
    total, chassis = (
        np.linalg.norm([last(recorder, f"a{axis}{axes}_mps2") for axis in "xyz"]) for axes in ("", "_chassis")
    )
    assert total == pytest.approx(chassis, rel=1e-6)
    assert last(recorder, "ay_mps2") == pytest.approx(last(recorder, "latacc_com_mps2"), abs=1e-9)


def test_length_of_a_spring_is_the_distance_of_its_ends(left_turn):
    sim, _, recorder = left_turn
    joint = next(each for each in sim.model.builder.joints if each.name.startswith("axle0.left.spring"))
    ends = []
    for body, frame in ((joint.parent, joint.frame0), (joint.child, joint.frame1)):
        turn = matrices(sim.state.body_rot.numpy()[0, body].astype(float))
        ends.append(sim.state.body_x.numpy()[0, body] + turn @ np.asarray(frame.position))
    # float32 rotations over arms of half a metre
    assert last(recorder, "springlength_FL_m") == pytest.approx(float(np.linalg.norm(ends[1] - ends[0])), abs=1e-5)


def test_springs_and_dampers_push_as_their_joints_do(left_turn):
    """A spring by table and a damper by map. Reactions may be a step old: the spring's force changes by 5 N in it, the
    damper's, of 68 N, by less than 1 %.
    """
    _, _, recorder = left_turn
    for wheel, side in (("FL", "axle0.left"), ("RR", "axle1.right")):
        for channel, joint, tolerance in (
            (f"spring_{wheel}_N", "spring0", 1e-3),
            (f"damper2_{wheel}_N", "spring1", 1e-2),
        ):
            reaction = np.linalg.norm([last(recorder, f"reaction:{side}.{joint}.F{axis}_N") for axis in "xyz"])
            assert abs(last(recorder, channel)) == pytest.approx(reaction, rel=tolerance)


def test_rolling_resists_and_the_load_stands_aside(left_turn):
    """On a forward roll My is negative, by some hundredths of the load times the radius; in a left turn, tires that are
    dragged to the left by their rims have their patch, and so the load, behind them: Mz turns the wheel back."""
    _, car, recorder = left_turn
    for wheel, name in enumerate(wheel_names(2)):
        radius = car.parts.spec.axles[car.parts.sides[wheel].axle].tire.radius
        arm = last(recorder, f"Fz_{name}_N") * radius
        assert -0.05 * arm < last(recorder, f"My_{name}_Nm") < -0.002 * arm
        assert last(recorder, f"Mz_{name}_Nm") * last(recorder, f"Fy_{name}_N") < 0.0


def test_unknown_channels_are_refused_with_near_names(left_turn):
    sim, car, _ = left_turn
    with pytest.raises(SpecError, match=r"got 'Fx_FK_N'; did you mean Fx_F._N"):
        Recorder(sim, car, channels=["Fx_FK_N"])


def test_a_record_with_channels_survives_its_file(left_turn, tmp_path):
    _, _, recorder = left_turn
    run = Run.of(recorder)
    run.write(tmp_path / "run.csv")
    again = Run.read(tmp_path / "run.csv")
    assert list(again.columns) == list(recorder.names)
    # nine digits are written
    assert np.allclose(np.array(list(again.columns.values())), np.array(list(run.columns.values())), rtol=1e-8)


def test_wheels_of_all_axles_have_names():
    assert wheel_names(2) == ("FL", "FR", "RL", "RR")
    assert wheel_names(4) == ("FL", "FR", "2L", "2R", "3L", "3R", "RL", "RR")
