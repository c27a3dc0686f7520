"""Laws of reduced vehicles: rest, energy, symmetry, worlds apart, virtual work, and one step against NumPy."""

import dataclasses

import numpy as np
import pytest

import simwarp as sw
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.spec.vehicle_files import load_vehicle, reduced_vehicle_names
from simwarp.vehicle.vehicle import VEHICLE_SOLVER, Vehicle, per_world
from tests.reference.reduced_vehicles import Motion, Reference
from tests.reference.step_rows import matrices

NAMES = reduced_vehicle_names()
COASTING = {"driveline": None, "engine": None, "transmission": None}


class Rig:
    """A reduced vehicle in some worlds."""

    def __init__(self, name, worlds=1, *, dt=1.0e-3, wheel_bodies=False, threads=1, parts=None, **start):
        builder = sw.ModelBuilder()
        self.spec = dataclasses.replace(load_vehicle(name), **(parts or {}))
        self.parts = add_vehicle(builder, self.spec, wheel_bodies=wheel_bodies, **start)
        self.model = builder.finalize(worlds, "cpu", per_world=per_world(["body_mass"]))
        self.vehicle = Vehicle(self.parts, self.model, randomised=True)
        self.sim = sw.Simulation(self.model, dt, elements=[self.vehicle], solver=VEHICLE_SOLVER, threads=threads)
        self.wheels = self.vehicle.reduced

    def drive(self, *, steering=0.0, throttle=0.0, braking=0.0):
        """Sets the inputs; one for all worlds, or one each."""
        values = np.zeros((self.model.world_count, 4), np.float32)
        values[:, 0], values[:, 1], values[:, 2] = steering, throttle, braking
        self.vehicle.input.assign(values)
        return self

    def content(self):
        """All that a run consists of."""
        state = self.sim.state
        found = {name: getattr(state, name).numpy().copy() for name in state.NAMES}
        found |= {name: array.numpy().copy() for name, array in self.vehicle.memory.items()}
        return found | {"load": self.vehicle.tires.load.numpy().copy()}

    def motion(self, world=0):
        """Of a world, in axes of the chassis."""
        state, body = self.sim.state, self.parts.chassis
        turn = matrices(state.body_rot.numpy()[world])[body]
        inputs = self.vehicle.input.numpy()[world]
        travel, rate, spin = (
            getattr(self.wheels, name).numpy()[world].astype(float) for name in ("travel", "travel_rate", "spin")
        )
        return turn, Motion(
            turn.T @ state.body_v.numpy()[world, body], turn.T @ state.body_omega.numpy()[world, body],
            travel, rate, spin, float(inputs[0]), float(inputs[2]),
        )  # fmt: skip

    def reference(self):
        """The account in NumPy."""
        body = self.model.builder.bodies[self.parts.chassis]
        return Reference(self.spec, body.mass, body.inertia, self.parts.reference)


def equal(run, other, worlds=slice(None), others=slice(None)):
    for name, values in run.items():
        assert values[worlds].tobytes() == other[name][others].tobytes(), name


@pytest.mark.parametrize("name", NAMES)
def test_it_stands_still_on_loads_that_sum_to_its_weight(name):
    rig = Rig(name).drive(braking=1.0)
    rig.sim.step(4000)
    weight = 9.81 * rig.model.builder.bodies[rig.parts.chassis].mass
    # bristles and springs are at rest to what float32 resolves of a force over the mass in one step
    assert np.abs(rig.sim.state.body_v.numpy()).max() < 1e-3
    assert rig.vehicle.tires.load.numpy().sum() == pytest.approx(weight, rel=1e-3)
    assert np.abs(rig.wheels.travel_rate.numpy()).max() < 1e-3
    begin = rig.vehicle.position.numpy().copy()
    rig.sim.step(1000)
    assert np.abs(rig.vehicle.position.numpy() - begin).max() < 1e-3


def stored(rig):
    """Energy of a coasting vehicle [J]: chassis, wheels, springs and the tires' springs."""
    turn, m = rig.motion()
    account = rig.reference()
    force = np.array([p for _, p, _ in map(account.moving, range(4))])
    moment = np.array([h for _, _, h in map(account.moving, range(4))])
    masses = np.array([mass for mass, _, _ in map(account.moving, range(4))])
    kinetic = 0.5 * account.mass * m.v @ m.v + 0.5 * m.omega @ account.inertia @ m.omega
    kinetic += m.rate @ (force @ m.v + moment @ m.omega) + 0.5 * masses @ m.rate**2
    kinetic += 0.5 * account.spin_inertia() @ m.spin**2
    height = float(rig.sim.state.body_x.numpy()[0, rig.parts.chassis, 2])
    potential = 9.81 * (account.mass * height + m.travel @ (force @ turn.T)[:, 2])
    for wheel in range(4):
        suspension, table = account.table(wheel)
        if not suspension.fixed:
            z = np.linspace(suspension.standing, m.travel[wheel], 2001)
            assert suspension.travel[0] < m.travel[wheel] < suspension.travel[-1]
            column = len(suspension.steering) // 2
            potential += np.trapezoid(np.interp(z, suspension.travel, [row[column] for row in table.spring_load]), z)
    return kinetic, potential


@pytest.mark.parametrize("name", NAMES)
def test_energy_falls_while_it_coasts(name):
    rig = Rig(name, speed=5.0, parts=COASTING)
    rig.sim.step(1500)
    energies = []
    for _ in range(40):
        rig.sim.step(50)
        energies.append(sum(stored(rig)))
    # rolling resistance takes more in 50 ms than springs exchange once the start has died out
    assert np.diff(energies).max() < 0.0
    assert rig.vehicle.velocity_b.numpy()[0, 0] > 1.0


def test_a_symmetric_vehicle_stays_straight():
    rig = Rig("sedan-14dof").drive(throttle=0.5)
    rig.sim.step(3000)
    place = rig.vehicle.position.numpy()[0]
    assert place[0] > 5.0
    # both sides get the same numbers up to the order of their sums in float32
    assert abs(place[1]) < 1e-4 * place[0]


@pytest.mark.parametrize("name", NAMES)
def test_worlds_know_nothing_of_each_other(name):
    def run(worlds, scale):
        rig = Rig(name, worlds).drive(steering=np.linspace(-0.2, 0.2, 5)[:worlds], throttle=0.6)
        factors = rig.wheels.scale.numpy()
        factors[-1] *= scale
        rig.wheels.scale.assign(factors)
        rig.sim.step(400)
        return rig.content()

    five, changed, one = run(5, 1.0), run(5, 0.7), run(1, 1.0)
    equal(five, run(5, 1.0))
    equal(five, changed, slice(0, 4), slice(0, 4))
    equal(five, one, slice(0, 1), slice(0, 1))
    assert not np.array_equal(five["wheels_travel"][4], changed["wheels_travel"][4])


def test_threads_change_nothing():
    runs = []
    for threads in (1, 2):
        rig = Rig("hmmwv-14dof", 9, threads=threads, wheel_bodies=True).drive(
            steering=np.linspace(-0.3, 0.3, 9), throttle=1.0
        )
        rig.sim.step(200)
        runs.append(rig.content())
    equal(*runs)


def test_a_snapshot_and_a_reset_bring_everything_back():
    rig = Rig("hmmwv-14dof", 2, speed=8.0).drive(steering=0.2, throttle=0.4)
    rig.sim.step(100)
    kept = rig.sim.snapshot()
    rig.sim.step(200)
    run = rig.content()
    rig.sim.restore(kept)
    rig.sim.step(200)
    equal(run, rig.content())
    rig.sim.reset()
    assert rig.wheels.travel_rate.numpy().max() == 0.0
    assert rig.wheels.spin.numpy()[0] == pytest.approx(8.0 / rig.spec.axles[0].tire.radius)
    rig.drive(steering=0.2, throttle=0.4)
    rig.sim.step(300)
    equal(run, rig.content())


@pytest.mark.parametrize("dt", [2.0e-3, 5.0e-3])
def test_longer_steps_hold_and_lead_the_same_way(dt):
    places = []
    for step in (1.0e-3, dt):
        rig = Rig("hmmwv-14dof", dt=step, speed=10.0).drive(steering=0.1)
        rig.sim.step(round(2.0 / step))
        places.append(rig.vehicle.position.numpy()[0])
    # first order in the step: what a HMMWV leans and yields in its first moments
    assert np.linalg.norm(places[1] - places[0]) < 0.05 * dt / 1.0e-3


def test_bodies_of_wheels_show_them_and_change_nothing():
    shown, plain = (
        Rig("hmmwv-14dof", wheel_bodies=bodies, speed=6.0).drive(steering=0.3, throttle=0.5) for bodies in (True, False)
    )
    for rig in (shown, plain):
        rig.sim.step(500)
    assert shown.vehicle.position.numpy().tobytes() == plain.vehicle.position.numpy().tobytes()
    assert shown.wheels.travel.numpy().tobytes() == plain.wheels.travel.numpy().tobytes()
    turn, m = shown.motion()
    account, state = shown.reference(), shown.sim.state
    for wheel, side in enumerate(shown.parts.sides):
        r, axis = account.place(wheel, m.travel[wheel], m.steering)
        x = state.body_x.numpy()[0, side.spindle] - state.body_x.numpy()[0, shown.parts.chassis]
        assert turn.T @ x == pytest.approx(r, abs=1e-6)
        assert turn.T @ matrices(state.body_rot.numpy()[0, [side.spindle]])[0, :, 1] == pytest.approx(axis, abs=1e-6)
        v, omega = account.wheel_motion(wheel, m)
        assert turn.T @ state.body_v.numpy()[0, side.spindle] == pytest.approx(v, abs=1e-4)
        assert turn.T @ state.body_omega.numpy()[0, side.spindle] == pytest.approx(omega, abs=1e-3)


def wheels_of(rig):
    """Poses and velocities of the bodies that show wheels."""
    bodies = [side.spindle for side in rig.parts.sides]
    names = ("body_x", "body_rot", "body_q", "body_v", "body_omega")
    return {name: getattr(rig.sim.state, name).numpy()[:, bodies].copy() for name in names}


def test_wheels_are_shown_alike_after_one_call_and_after_many():
    at_once, one_by_one = (Rig("sedan-14dof", 2, wheel_bodies=True, speed=6.0) for _ in range(2))
    for rig in (at_once, one_by_one):
        rig.drive(steering=0.3, throttle=[0.2, 0.8])
    at_once.sim.step(60)
    for _ in range(60):
        one_by_one.sim.step()
    equal(wheels_of(at_once), wheels_of(one_by_one))


def test_a_kerb_is_climbed_within_one_call():
    """Obstacles are looked for around the bodies of wheels, which are moved in every step there."""
    heights = []
    for ahead in (4.0, 400.0):
        builder = sw.ModelBuilder()
        parts = add_vehicle(builder, load_vehicle("hmmwv-14dof"), speed=6.0)
        builder.add_shape_box(sw.WORLD, half=(1.0, 4.0, 0.1), pose=sw.pose((ahead + 1.0, 0.0, 0.0)), name="kerb")
        model = builder.finalize(1, "cpu", per_world=per_world())
        vehicle = Vehicle(parts, model, obstacles=["kerb"])
        sim = sw.Simulation(model, 1.0e-3, elements=[vehicle], solver=VEHICLE_SOLVER)
        sim.step(600)  # front wheels are at 1.6 m + 3.6 m then
        heights.append(sim.state.body_x.numpy()[0, [side.spindle for side in parts.sides], 2])
    climbed = heights[0] - heights[1]
    assert climbed[:2] == pytest.approx([0.1, 0.1], abs=0.04)  # of 0.1 m, tires and springs swing by some of it
    assert np.abs(climbed[2:]).max() < 0.02  # the rear ones are before it


def at_a_place(name, seed):
    """A coasting vehicle in the middle of some motion, and what one step makes of it."""
    rng = np.random.default_rng(seed)
    rig = Rig(name, parts=COASTING, speed=8.0).drive(steering=rng.uniform(-0.8, 0.8))
    rig.sim.step(int(rng.integers(100, 400)))
    before = rig.motion()
    rig.sim.step()
    turn, m = before
    after = rig.motion()[1]
    wrench = [getattr(rig.vehicle.tires, n).numpy()[0].astype(float) @ turn for n in ("force_w", "torque_w")]
    control, body = rig.sim.control, rig.parts.chassis
    applied = [getattr(control, n).numpy()[0, body].astype(float) @ turn for n in ("element_force", "element_torque")]
    return rig, m, after, wrench, applied


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", range(3))
def test_one_step_is_that_of_the_account_in_numpy(name, seed):
    rig, m, after, (force, torque), applied = at_a_place(name, seed)
    dt, account = 1.0e-3, rig.reference()
    chassis, travels, spins = account.accelerations(m, force, torque, dt)
    # float32 of rates of up to 30 over a step of 1 ms: 3e-3 m/s² of travels, more of spins
    assert (after.rate - m.rate) / dt == pytest.approx(travels, rel=2e-3, abs=2e-2)
    assert (after.spin - m.spin) / dt == pytest.approx(spins, rel=2e-3, abs=5e-2)
    gyroscopic = np.cross(m.omega, account.inertia @ m.omega)
    assert applied[0] == pytest.approx(account.mass * chassis[:3], rel=1e-3, abs=5.0)
    assert applied[1] == pytest.approx(account.inertia @ chassis[3:] + gyroscopic, rel=1e-3, abs=5.0)


@pytest.mark.parametrize("name", NAMES)
def test_forces_do_as_much_work_on_chassis_travel_and_spin_as_on_the_wheel(name):
    rig, m, _, (force, torque), _ = at_a_place(name, 7)
    account = rig.reference()
    for wheel in range(4):
        v, omega = account.wheel_motion(wheel, m)
        r, axis = account.place(wheel, m.travel[wheel], m.steering)
        slope, lean, _ = account.slopes(wheel, m.travel[wheel], m.steering)
        f, t = force[wheel], torque[wheel]
        chassis = f @ m.v + (np.cross(r, f) + t - axis * (axis @ t)) @ m.omega
        travel = (slope @ f + lean @ t) * m.rate[wheel]
        # slopes are differences of the tables' places: what is left is their rounding
        assert chassis + travel + (axis @ t) * m.spin[wheel] == pytest.approx(f @ v + t @ omega, rel=1e-9, abs=1e-6)
