"""Models with meshes, what they carry, and one step of them by dense algebra in float64."""

import numpy as np
from scipy.spatial.transform import Rotation

import simwarp as sw
from simwarp.core.types import WORLD
from tests.unit.flex.free_meshes import make_mesh
from tests.unit.flex.loaded_meshes import loads

SIZE = (0.12, 0.1, 0.08)
RUBBER = sw.flex.Rubber(young=1e5, poisson=0.4, density=1000.0, damping_time=1e-3)
QUIET = sw.flex.Options(numerical_damping=1.0)
UNDAMPED = sw.flex.Options(numerical_damping=0.0)


def simulation(builder, dt=1e-3, worlds=1, damping=0.1, **options):
    """A simulation on the CPU."""
    flex = sw.flex.Options(numerical_damping=damping)
    return sw.Simulation(builder.finalize(worlds, "cpu", **options), dt, flex=flex)


def own_bodies(mesh):
    """Bodies of nodes that move by themselves."""
    return [mesh.bodies[node] for node in mesh.nodes]


def node_masses(sim, world=0):
    """(bodies,) [kg]."""
    mass = sim.model.body_mass.numpy()
    return mass[world if len(mass) > 1 else 0].astype(float)


def momenta(sim, world=0, about=(0.0, 0.0, 0.0)):
    """Linear momentum, and angular momentum about a point, of the published state."""
    mass, state = node_masses(sim, world), sim.state
    x, v = state.body_x.numpy()[world] - np.asarray(about), state.body_v.numpy()[world].astype(float)
    turns = Rotation.from_quat(state.body_rot.numpy()[world])
    spin = turns.inv().apply(state.body_omega.numpy()[world])
    inertia = sim.model.body_inertia_b.numpy()[0].astype(float)
    own = turns.apply(np.einsum("bij,bj->bi", inertia, spin))
    return mass @ v, (np.cross(x, mass[:, None] * v) + own).sum(axis=0)


def energy(sim, world=0):
    """[J]"""
    return float(sim.measure_energy().numpy()[world])


def potential(sim, world=0):
    """Of weights, springs and strains [J]."""
    state, mass = sim.state, node_masses(sim, world)
    v, omega = state.body_v.numpy()[world].astype(float), state.body_omega.numpy()[world].astype(float)
    spin = Rotation.from_quat(state.body_rot.numpy()[world]).inv().apply(omega)
    turning = np.einsum("bi,bij,bj", spin, sim.model.body_inertia_b.numpy()[0].astype(float), spin)
    return energy(sim, world) - 0.5 * float(mass @ (v**2).sum(axis=1)) - 0.5 * float(turning)


def energies(sim, steps, each=1):
    """(steps / each,) kinetic energy of a step's velocities and the mean of the potential ones at its ends: what the
    trapezoidal rule keeps of linear oscillations [J].
    """
    found = []
    for _ in range(steps // each):
        if each > 1:
            sim.step(each - 1)
        before = potential(sim)
        sim.step()
        found.append(energy(sim) + 0.5 * (before - potential(sim)))
    return np.array(found)


def set_motion(sim, v=None, omega=None, x=None):
    """Writes velocities and places of bodies in all worlds, and brings the rest of the state up to date."""
    for array, value in ((sim.state.body_v, v), (sim.state.body_omega, omega), (sim.state.body_x, x)):
        if value is not None:
            array.assign(np.broadcast_to(value, array.numpy().shape).astype(array.numpy().dtype))
    sim.measure()


def push(sim, bodies, force):
    """Equal shares of a force on bodies."""
    given = sim.control.body_force.numpy().copy()
    given[:, list(bodies)] = np.asarray(force, float) / len(bodies)
    sim.control.body_force.assign(given)


def settle(sim, mesh, *, most=4000, each=20, share=0.85, still=1e-6):
    """Steps until the nodes of meshes rest, with a share of their velocity taken every few steps; returns the largest
    speed that is left [m/s].
    """
    meshes = mesh if isinstance(mesh, (list, tuple)) else [mesh]
    bodies = [body for one in meshes for body in own_bodies(one)]
    speed = np.inf
    for _ in range(most // each):
        sim.step(each)
        v = sim.state.body_v.numpy()
        speed = float(np.abs(v[:, bodies]).max())
        if speed < still:
            break
        v[:, bodies] *= share
        sim.state.body_v.assign(v)
    return speed


def skew(r):
    """The matrix of r ×."""
    return np.array([[0.0, -r[2], r[1]], [r[2], 0.0, -r[0]], [-r[1], r[0], 0.0]])


class DenseStep:
    """The velocities after a step of a model whose joints are revolute, spherical or fixed: all bodies' velocities are
    unknowns, rows of joints are multipliers.
    """

    def __init__(self, sim, forces=None):
        model, state = sim.model, sim.state
        self.h = sim.dt
        self.gravity = np.asarray(model.builder.gravity, float)
        self.x = state.body_x.numpy()[0].astype(float)
        self.turns = Rotation.from_quat(state.body_rot.numpy()[0]).as_matrix()
        self.v = state.body_v.numpy()[0].astype(float)
        self.omega = state.body_omega.numpy()[0].astype(float)
        self.mass = node_masses(sim)
        self.inertia = model.body_inertia_b.numpy()[0].astype(float)
        meshes = model.builder.flexible_meshes
        self.nodes = {body for mesh in meshes for body in own_bodies(mesh)}
        self.first, count = {}, 0
        for body in range(len(self.mass)):
            self.first[body] = count
            count += 3 if body in self.nodes else 6
        self.count = count
        self.matrix, self.impulse = np.zeros((count, count)), np.zeros(count)
        self._add_bodies(forces)
        for mesh in meshes:
            self._add_mesh(sim, mesh)
        rows = [row for joint in model.builder.joints for row in self.joint_rows(joint)]
        self.rows = np.array(rows) if rows else np.zeros((0, count))

    def _add_bodies(self, forces):
        for body, k in self.first.items():
            self.matrix[k : k + 3, k : k + 3] += self.mass[body] * np.eye(3)
            self.impulse[k : k + 3] += self.h * self.mass[body] * self.gravity
            if forces is not None:
                self.impulse[k : k + 3] += self.h * forces[body]
            if body not in self.nodes:
                turn = self.turns[body]
                self.matrix[k + 3 : k + 6, k + 3 : k + 6] += turn @ self.inertia[body] @ turn.T

    def spread(self, body, place):
        """(3, count) velocity of a point of a body."""
        found = np.zeros((3, self.count))
        if body == WORLD:
            return found
        k = self.first[body]
        found[:, k : k + 3] = np.eye(3)
        if body not in self.nodes:
            found[:, k + 3 : k + 6] = -skew(place - self.x[body])
        return found

    def velocities(self):
        """(count,) at the start."""
        return np.concatenate([
            self.v[body] if body in self.nodes else [*self.v[body], *self.omega[body]] for body in self.first
        ])  # fmt: skip

    def _add_mesh(self, sim, mesh):
        places = sw.flex.mesh_positions(sim, mesh).numpy()[0]
        spread = np.concatenate([self.spread(*pair) for pair in zip(mesh.bodies, places, strict=True)])
        made = make_mesh(mesh.name, mesh.points, list(mesh.parts), device="cpu")
        speeds = (spread @ self.velocities()).reshape(-1, 3).astype(np.float32)
        forces, matrix, _ = loads(made, places, speeds, h=self.h, zeta=sim.flex.numerical_damping)
        self.matrix += spread.T @ (matrix @ spread)
        self.impulse += self.h * spread.T @ forces.reshape(-1)

    def joint_rows(self, joint):
        """Rows of velocities that a joint keeps at zero."""
        a, b = joint.parent, joint.child
        place = self.x[b] + self.turns[b] @ np.asarray(joint.frame1.position)
        rows = list(self.spread(a, place) - self.spread(b, place))
        kind = joint.type.name
        if kind == "SPHERICAL":
            return rows
        turning = np.zeros((3, self.count))
        for body, sign in ((a, 1.0), (b, -1.0)):
            if body != WORLD:
                turning[:, self.first[body] + 3 : self.first[body] + 6] += sign * np.eye(3)
        if kind == "REVOLUTE":
            axis = self.turns[b] @ Rotation.from_quat(joint.frame1.rotation).apply((0.0, 0.0, 1.0))
            turning = np.linalg.svd(axis[None])[2][1:] @ turning
        return rows + list(turning)

    def solve(self):
        """(bodies, 3) changes of velocity and of angular velocity, zero of nodes."""
        m = len(self.rows)
        whole = np.block([[self.matrix, self.rows.T], [self.rows, np.zeros((m, m))]])
        right = np.concatenate([self.impulse, -self.rows @ self.velocities()])
        return self.by_body(np.linalg.solve(whole, right)[: self.count])

    def by_body(self, change):
        """The same of all velocities."""
        lin, ang = np.zeros((2, len(self.first), 3))
        for body, k in self.first.items():
            lin[body] = change[k : k + 3]
            if body not in self.nodes:
                ang[body] = change[k + 3 : k + 6]
        return lin, ang
