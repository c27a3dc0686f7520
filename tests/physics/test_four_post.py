"""A four-post rig against a quarter car in closed form and a linear model; roads against their own spectra."""

from __future__ import annotations

import dataclasses
import re
from typing import Any

import numpy as np
import pytest

from simwarp.analysis import linearise
from simwarp.vehicle.rigs import (
    PostMode,
    RoadClass,
    RoadSweep,
    RowStatus,
    SineSweep,
    run_four_post,
    run_four_post_roads,
)
from simwarp.vehicle.rigs.post_rig import PostRig
from simwarp.vehicle.spec.vehicle_spec import (
    Chassis,
    ForceLine,
    RigidPart,
    SpecError,
    Tire,
    TrailingArm,
    VehicleSpec,
)
from tests.physics.sample_vehicles import samples, shipped

MASS, WHEEL, SPRING, DAMPER, TIRE, TIRE_DAMPER = 1200.0, 40.0, 25e3, 1.8e3, 2.2e5, 150.0
"""Of the chassis and of each of four wheels [kg]; of each spring and tire [N/m], and their dampers [N·s/m]."""
LONG = 19.0
"""Length of the arms [m]: their wheels move upwards alone, to a twentieth of their travel."""
WHEELBASE = 10.0
GRAVITY = 9.81


def upright_vehicle() -> VehicleSpec:
    """A vehicle of four quarter cars: its wheels move vertically against the chassis."""
    base = samples()["trailing-arm"]
    mount, below = (0.0, 0.8, 0.5), (0.0, 0.8, 0.0)
    rest = 0.5 + GRAVITY * MASS / 4.0 / SPRING
    arm = TrailingArm(
        spindle=RigidPart(mass=10.0, com=(0.0, 0.8, 0.0), inertia=(0.1, 0.1, 0.1)),
        arm=RigidPart(mass=10.0, com=(0.0, 0.8, 0.0), inertia=(1.0, 1.0, 1.0)), pivot=(LONG, 0.8, 0.0),
        springs=(
            ForceLine(chassis_point=mount, arm_point=below, stiffness=SPRING, rest_length=rest),
            ForceLine(chassis_point=mount, arm_point=below, damping=DAMPER),
        ),
        axle_inertia=0.1,
    )  # fmt: skip
    tire = Tire(
        template="fiala", mass=10.0, inertia=(0.5, 0.8, 0.5), radius=0.3, width=0.2,
        parameters={
            "vertical_stiffness": TIRE, "vertical_damping": TIRE_DAMPER, "slip_stiffness": 1e5,
            "cornering_stiffness": 5e4, "friction_sliding": 0.8, "friction_static": 1.0,
        },
    )  # fmt: skip
    axles = tuple(
        dataclasses.replace(
            axle, location=(x, 0.0, 0.3), suspension=arm, tire=tire, antiroll_bar=None, steering=None,
            wheel=dataclasses.replace(axle.wheel, mass=10.0, inertia=(0.5, 0.8, 0.5), offset=0.0),
        )
        for axle, x in zip(base.axles, (0.5 * WHEELBASE, -0.5 * WHEELBASE), strict=True)
    )  # fmt: skip
    chassis = Chassis(components=(RigidPart(mass=MASS, com=(0.0, 0.0, 0.6), inertia=(400.0, 2e4, 2e4)),))
    return dataclasses.replace(base, chassis=chassis, axles=axles, steerings=(), wheelbase=WHEELBASE)


def quarter_car(frequency: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(n,) complex motion of the chassis, change of the wheel load [N/m] and travel of the wheel, per post's motion."""
    s = 2j * np.pi * frequency
    spring, tire = SPRING + s * DAMPER, TIRE + s * TIRE_DAMPER
    above, below = MASS / 4.0 * s**2 + spring, WHEEL * s**2 + spring + tire
    wheel = tire * above / (above * below - spring**2)
    chassis = wheel * spring / above
    return chassis, tire * (1.0 - wheel), wheel - chassis


@pytest.mark.slow
def test_heave_is_that_of_a_quarter_car():
    """Long arms turn by a twentieth of a wheel's travel, whose forces are second order; the step of 0.5 ms errs by some
    h omega / 2: 1 % at the resonance of the wheels, at 12 Hz.
    """
    sweep = SineSweep(modes=(PostMode.HEAVE,), low=0.7, high=16.0, points=9, amplitude=0.002, cycles=4)
    found = run_four_post(upright_vehicle(), sweep, dt=5e-4)
    assert (found.status == RowStatus.DONE).all()
    assert found.static_load == pytest.approx(GRAVITY * (MASS / 4.0 + WHEEL), rel=2e-3)
    heave, load, travel = quarter_car(found.frequency)
    assert np.abs(found.heave - heave).max() < 0.02 * np.abs(heave).max()
    assert np.abs(found.load - load[:, None]).max() < 0.02 * np.abs(load).max()
    assert np.abs(found.travel - travel[:, None]).max() < 0.02 * np.abs(travel).max()
    # where neither chassis nor wheel is near a resonance, a step's error is a part of it: posts that run ahead of the
    # vehicle by a step would lead by all of it
    step = 2.0 * np.pi * found.frequency * 5e-4
    between = (found.frequency > 2.5) & (found.frequency < 9.0)
    assert np.abs(np.angle(found.travel[:, 0] / travel) / step)[between].max() < 0.5
    assert found.acceleration == pytest.approx(-((2.0 * np.pi * found.frequency) ** 2) * found.heave)
    # a symmetric vehicle neither pitches nor rolls
    assert np.abs(found.pitch).max() < 0.02
    assert np.abs(found.roll).max() < 0.02


@pytest.mark.slow
def test_the_sedan_answers_as_its_linear_model():
    """Linearised where it stands on posts without grip, with their heights and speeds as inputs: sines of a millimetre
    answer as the model within 5 % of its peak, which is what the damping of a step of 0.5 ms leaves of a resonance by
    three. (Bristles that hold patches are no coordinates of a linear model.)
    """
    sweep = SineSweep(
        modes=(PostMode.HEAVE,), low=1.5, high=8.0, points=4, amplitude=1e-3, speed=0.02, cycles=4, grip=1e-5
    )  # fmt: skip
    spec = shipped("sedan")
    found = run_four_post(spec, sweep, dt=5e-4)
    rig = PostRig(spec, 16, grip=1e-5)
    rig.simulation.step(4000)
    chassis, shape = rig.vehicle.parts.chassis, rig.loads().shape
    changes = {}
    for kind, size in (("height", 1e-4), ("speed", 1e-3)):
        ends = []
        for way in (1.0, -1.0):
            values = {"height": np.zeros(shape), "speed": np.zeros(shape)}
            values[kind] += way * size
            rig.move(values["height"], values["speed"])
            ends.append(linearise(rig.simulation, inputs=()).acceleration)
        changes[kind] = (ends[0] - ends[1]) / (2.0 * size)
    rig.move(np.zeros(shape), np.zeros(shape))
    linear = linearise(rig.simulation, inputs=())
    count = len(linear.coordinates)
    model = []
    for frequency in found.frequency:
        s = 2j * np.pi * frequency
        force = np.concatenate([np.zeros(count), changes["height"] + s * changes["speed"]])
        answer = np.linalg.solve(s * np.eye(2 * count) - linear.a, force)
        model.append(linear.bodies[chassis, 2] @ answer[:count])
    assert np.abs(found.heave - np.array(model)).max() < 0.05 * np.abs(model).max()


@pytest.mark.slow
def test_a_rougher_road_shakes_more_by_its_class():
    """Heights double from class to class, and so does what a nearly linear vehicle does on smooth ones."""
    sweep = RoadSweep(roads=(RoadClass.A, RoadClass.B), speeds=(10.0,), duration=5.0)
    found = run_four_post_roads(upright_vehicle(), sweep)
    assert (found.status == RowStatus.DONE).all()
    for name in ("acceleration", "load_variation", "travel"):
        values = getattr(found, name)
        assert values[1] / values[0] == pytest.approx(np.full_like(values[0], 2.0), rel=0.05), name
    assert (found.least_load > 0.0).all()
    assert [entry["road"] for entry in found.parameters()] == ["A", "B"]


def test_an_interruption_keeps_worlds_whose_cycles_are_complete():
    """High frequencies are through first."""
    sweep = SineSweep(
        modes=(PostMode.HEAVE,), low=2.0, high=20.0, points=2, settle=0.1, transient=0.0, cycles=2
    )  # fmt: skip

    def progress(share: float) -> None:
        if share > 0.6:
            raise KeyboardInterrupt

    found = run_four_post(shipped("artcar"), sweep, dt=2e-3, progress=progress)
    assert found.status.tolist() == [RowStatus.UNFINISHED, RowStatus.DONE]
    assert np.isnan(found.heave[0])
    assert np.isfinite(np.abs(found.heave[1]))


def test_a_world_is_the_same_alone_and_in_a_batch():
    options: Any = {"modes": (PostMode.HEAVE,), "settle": 0.2, "transient": 0.0, "cycles": 1, "amplitude": 1e-3}
    both = run_four_post(shipped("artcar"), SineSweep(low=4.0, high=16.0, points=3, **options), dt=2e-3)
    few = run_four_post(shipped("artcar"), SineSweep(low=8.0, high=16.0, points=2, **options), dt=2e-3)
    assert both.heave[1:] == pytest.approx(few.heave, abs=1e-12)
    assert (both.load[2] == few.load[1]).all()


@pytest.mark.parametrize(
    ("sweep", "message"),
    [
        (SineSweep(low=5.0, high=2.0), "frequencies: must be 0 < low < high < 100 Hz, got 5 to 2"),
        (SineSweep(points=1), "sweep: must have a mode, 2 points and 1 cycle at least"),
        (SineSweep(amplitude=0.0), "amplitude: must be > 0"),
        (SineSweep(settle=np.inf), "settle: must be >= 0 s and finite"),
        (SineSweep(grip=0.0), "grip: must be above 0"),
    ],
)
def test_an_empty_range_is_one_line(sweep, message):
    with pytest.raises(SpecError, match=message):
        run_four_post(shipped("artcar"), sweep)


@pytest.mark.parametrize(
    ("sweep", "message"),
    [
        (RoadSweep(roads=()), "roads: must hold one class and one speed"),
        (RoadSweep(speeds=(10.0, np.nan)), "speeds: must be > 0 m/s and finite, got nan"),
        (RoadSweep(duration=np.inf), "duration: must be finite"),
        (RoadSweep(settle=-1.0), "settle: must be >= 0 s"),
    ],
)
def test_a_road_that_cannot_be_driven_is_one_line(sweep, message):
    with pytest.raises(SpecError, match=message):
        run_four_post_roads(shipped("artcar"), sweep)


def overflow(rig: PostRig, world: int) -> None:
    """Gives the vehicle of a world a speed whose square is beyond float32."""
    v = rig.simulation.state.body_v.numpy().copy()
    v[world, :, 2] = 1e30
    rig.simulation.state.body_v.assign(v)


def test_a_world_that_breaks_down_says_when_and_which_body_and_the_others_go_on():
    rig = PostRig(shipped("artcar"), 3, dt=1e-3)
    for _ in range(3):
        rig.step()
    overflow(rig, 1)
    for _ in range(3):
        rig.step()
    assert rig.broken().tolist() == [False, True, False]
    assert [rig.reason[0], rig.reason[2]] == ["", ""]
    found = re.fullmatch(r"a value is not finite from t = ([\d.]+) s on; the fastest body is '(.+)' at .+ m/s",
                         rig.reason[1])  # fmt: skip
    assert found is not None
    assert 0.0025 < float(found[1]) < 0.0065  # of the steps after the third one
    assert found[2] in rig.simulation.model.body_names


@pytest.mark.slow
def test_a_road_that_breaks_a_vehicle_is_one_row(monkeypatch):
    """The vehicle of one of two roads breaks down: its row is marked and says why, the other has its numbers."""
    sweep = RoadSweep(roads=(RoadClass.A, RoadClass.E), duration=0.2, settle=0.1)
    quiet = run_four_post_roads(shipped("artcar"), sweep)
    move = PostRig.move

    def thrown(rig, height, speed):
        overflow(rig, 1)
        move(rig, height, speed)

    monkeypatch.setattr(PostRig, "move", thrown)
    found = run_four_post_roads(shipped("artcar"), sweep)
    assert found.status.tolist() == [RowStatus.DONE, RowStatus.DIVERGED]
    assert found.acceleration[0] == quiet.acceleration[0]
    (line,) = found.rows().divergences()
    assert line.startswith("road E, speed_mps 15: a value is not finite from t = 0.1")
