"""The tire machine against laws in closed form and the signs of ISO 8855."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from simwarp.vehicle import load_vehicle, option_names, with_options
from simwarp.vehicle.rigs import RowStatus, TireSweep, run_tire_rig, tire_forces
from simwarp.vehicle.rigs.tire_rig import SMALL_SLIP, _Machine, rig_vector, static_deflection
from simwarp.vehicle.spec.vehicle_spec import SpecError, Tire
from simwarp.vehicle.tires.parameter_vector import MODELS
from tests.physics.sample_vehicles import shipped


def tire_of(vehicle: str, name: str) -> Tire:
    return with_options(load_vehicle(vehicle), tire=name).axles[0].tire


FIALA = tire_of("hmmwv", "fiala")
VALUES: Any = FIALA.parameters


def fiala(slip: np.ndarray, angle: np.ndarray, load: np.ndarray) -> np.ndarray:
    """(3, n) F_x, F_y, M_z of Fiala's brush, as Adams/Tire writes it."""
    stiff, cornering = VALUES["slip_stiffness"], VALUES["cornering_stiffness"]
    tangent = np.tan(angle)
    total = np.minimum(np.hypot(slip, tangent), 1.0)
    friction = VALUES["friction_static"] - (VALUES["friction_static"] - VALUES["friction_sliding"]) * total
    q = friction * load
    safe = np.where(slip == 0.0, 1.0, np.abs(slip))
    along = np.where(np.abs(slip) > 0.5 * q / stiff, np.sign(slip) * (q - q**2 / (4.0 * safe * stiff)), stiff * slip)
    h = np.maximum(1.0 - cornering * np.abs(tangent) / (3.0 * q), 0.0)
    return np.stack(
        [along, -q * (1.0 - h**3) * np.sign(tangent), q * FIALA.width * (1.0 - h) * h**3 * np.sign(tangent)]
    )


def test_fialas_curves_are_its_law():
    """Slips of the kernel are float32 of some 1e-6; the forces follow with slopes below 2e5 N."""
    slip, angle = (v.ravel() for v in np.meshgrid(np.linspace(-0.5, 0.5, 11), np.linspace(-0.25, 0.25, 11)))
    found = tire_forces(FIALA, slip_ratio=slip, slip_angle=angle, load=5000.0)
    assert (found.status == RowStatus.DONE).all()
    assert found.load == pytest.approx(5000.0, rel=1e-4)
    wanted = fiala(slip, angle, found.load)
    for got, want in zip((found.fx, found.fy, found.mz), wanted, strict=True):
        assert got == pytest.approx(want, abs=0.5)


def test_fialas_stiffnesses_are_its_parameters():
    """The brush bends by C tan a / 3 Q of the slope over the small slips that the rig measures with."""
    curves = run_tire_rig(FIALA, TireSweep(loads=(3000.0, 6000.0), points=21))
    stiffness = VALUES["cornering_stiffness"]
    bend = stiffness * SMALL_SLIP / (3.0 * VALUES["friction_static"] * 3000.0)
    assert curves.cornering_stiffness[:, 0, 0] == pytest.approx(stiffness, rel=2.0 * bend)
    # a slip of 1e-4 is a difference of speeds of 2 mm/s of 20 m/s, which float32 has to 1e-3
    assert curves.slip_stiffness[:, 0, 0] == pytest.approx(VALUES["slip_stiffness"], rel=2e-3)
    assert curves.trail[:, 0, 0] == pytest.approx(FIALA.width / 3.0, rel=4.0 * bend)


@pytest.mark.parametrize(("slip", "angle"), [(0.5, 0.4), (0.02, 0.01)])
def test_peaks_are_those_of_the_law_whatever_the_sweep(slip, angle):
    sweep = TireSweep(loads=(2000.0, 4000.0, 8000.0), points=5, slip=slip, angle=angle)
    curves = run_tire_rig(FIALA, sweep)
    slips, angles = np.linspace(-1.0, 1.0, 401), np.linspace(-0.8, 0.8, 401)
    peaks = np.zeros((2, 3))
    for number, load in enumerate(sweep.loads):
        along, across = fiala(slips, 0.0 * slips, np.array(load)), fiala(0.0 * angles, angles, np.array(load))
        peaks[:, number] = along[0].max() / load, across[1].max() / load
        # where a peak is flat, float32 may take the neighbour of the law's
        assert slips[along[0].argmax()] == pytest.approx(curves.peak_slip[number, 0, 0, 0], abs=0.0051)
        assert angles[across[1].argmax()] == pytest.approx(curves.peak_angle[number, 0, 0, 0], abs=0.0041)
    for found in (curves.peak_driving, curves.peak_braking):
        assert found[:, 0, 0] == pytest.approx(peaks[0], rel=2e-4)
    for found in (curves.peak_left, curves.peak_right):
        assert found[:, 0, 0] == pytest.approx(peaks[1], rel=2e-4)
    slopes = [np.polyfit(sweep.loads, row, 1)[0] for row in peaks]
    assert curves.load_sensitivity[:, 0, 0] == pytest.approx(slopes, rel=2e-3)


SHIPPED = [
    (vehicle, name)
    for vehicle in ("hmmwv", "sedan", "gator", "artcar", "skid-steer")
    for name in option_names(vehicle, "tire")
    if tire_of(vehicle, name).template in MODELS
]


@pytest.mark.parametrize(("vehicle", "name"), SHIPPED)
def test_signs_are_those_of_iso_8855(vehicle, name):
    """A wheel that drifts to the left is pushed to the right and turned to the left; a driven one pushes ahead; rolling
    resistance turns against the roll. Loads are those that deflect the tire by 5 %.
    """
    tire = tire_of(vehicle, name)
    load = 0.4 * float(rig_vector(tire).values[8]) * 0.1 * tire.radius or 5000.0
    found = tire_forces(tire, slip_ratio=[0.0, 0.05, -0.05, 0.0], slip_angle=[0.05, 0.0, 0.0, 0.0], load=load)
    assert (found.status == RowStatus.DONE).all()
    assert found.fy[0] < 0.0
    assert found.mz[0] >= -1e-3 * load
    assert found.fx[1] > 0.0 > found.fx[2]
    assert found.my[3] <= 1e-6 * load  # none where the law has no resistance


def test_moments_are_about_the_contact_point():
    """Fiala's brush has no overturning moment: the lever from the wheel's centre is taken out, float32 of 2000 N·m."""
    found = tire_forces(FIALA, slip_angle=[0.1, -0.1, 0.0], inclination=[0.1, 0.1, -0.2], load=6000.0)
    assert found.mx == pytest.approx(0.0, abs=5e-3)


def test_an_inclined_wheel_has_the_slip_that_was_asked_for():
    """The slip that the kernel reports; float32 of speeds of 20 m/s."""
    lean, slip = np.array([0.0, 0.1, -0.2]), np.array([0.0, 0.02, 0.0])
    zero = np.zeros(3)
    machine = _Machine(
        rig_vector(FIALA), FIALA.radius, [slip, zero + 0.03, lean, zero + 5000.0, zero + 20.0], 0.9, "cpu"
    )
    machine.settle(None)
    assert machine.tires.slip_ratio.numpy()[:, 0] == pytest.approx(slip, abs=1e-6)
    assert machine.tires.slip_angle.numpy()[:, 0] == pytest.approx(0.03, abs=1e-6)
    assert machine.tires.camber.numpy()[:, 0] == pytest.approx(lean, abs=1e-6)
    assert machine.tires.deflection.numpy()[:, 0] == pytest.approx(machine.deflection, abs=1e-7)


def test_a_point_is_the_same_alone_and_in_a_batch():
    tire = tire_of("hmmwv", "lugre")
    loads = np.array([2000.0, 4000.0, 6000.0])
    batch = tire_forces(tire, slip_angle=0.05, slip_ratio=0.02, load=loads)
    for number, load in enumerate(loads):
        alone = tire_forces(tire, slip_angle=[0.05], slip_ratio=0.02, load=float(load))
        assert (alone.fx[0], alone.fy[0], alone.mz[0]) == (batch.fx[number], batch.fy[number], batch.mz[number])


def test_a_load_beyond_the_tire_is_marked_and_the_others_stay():
    soft = dataclasses.replace(FIALA, parameters={**VALUES, "vertical_curve": ((0.0, 0.0), (0.1, 1000.0))})
    found = tire_forces(soft, slip_angle=0.05, load=[500.0, 1e6])
    assert found.status.tolist() == [RowStatus.DONE, RowStatus.DIVERGED]
    assert np.isnan(found.fy[1])
    assert found.fy[0] < 0.0
    with pytest.raises(SpecError, match="load: must be one that the tire bears"):
        static_deflection(soft, 1e6)


def test_an_interruption_keeps_what_has_settled():
    """The progress of the second round interrupts: forces that no bristle delays are steady by then."""
    calls = []

    def progress(share: float) -> None:
        calls.append(share)
        if len(calls) == 2:
            raise KeyboardInterrupt

    found = tire_forces(tire_of("hmmwv", "lugre"), slip_angle=[0.0, 0.05], load=4000.0, progress=progress)
    assert len(calls) == 2
    assert set(found.status.tolist()) <= {RowStatus.DONE, RowStatus.UNFINISHED}
    assert (found.status == RowStatus.DONE).any()


def test_a_sweep_that_is_interrupted_says_so():
    def progress(share: float) -> None:
        raise KeyboardInterrupt

    sweep = TireSweep(loads=(4000.0,), points=5)
    with pytest.raises(KeyboardInterrupt):  # nothing is steady after a round: there is nothing to keep
        run_tire_rig(tire_of("hmmwv", "lugre"), sweep, progress=progress)
    assert not run_tire_rig(FIALA, sweep).interrupted


@pytest.mark.parametrize(
    ("sweep", "message"),
    [
        (TireSweep(loads=()), "loads: must hold one value or more"),
        (TireSweep(loads=(1.0,), slip=0.0), "slip: must be > 0, got 0: the range would be empty"),
        (TireSweep(loads=(1.0,), angle=2.0), "angle: must be below a right angle"),
        (TireSweep(loads=(-5.0,)), "load: must be > 0, got -5"),
        (TireSweep(loads=(1.0,), points=2), "points: must be 3 or more"),
    ],
)
def test_an_empty_range_is_one_line(sweep, message):
    with pytest.raises(SpecError, match=message):
        run_tire_rig(FIALA, sweep)


def test_a_tire_without_a_law_is_one_line():
    with pytest.raises(SpecError, match=r"template must be one of .*, got 'rigid'; take another tire"):
        tire_forces(tire_of("gator", "rigid"), load=1000.0)
    assert shipped("gator").axles[0].tire.template in MODELS
