"""Mechanisms with known answers, as builders: for `bench`, `verify`, examples and tests. SI units, Z up.

Every function returns a ModelBuilder whose initial state is assembled and whose initial velocities satisfy the
joints. Angles of planar mechanisms in the XZ plane are measured from +X towards +Z unless a docstring says otherwise.
"""

from __future__ import annotations

import math
from typing import Final, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from simwarp.core.rotation import frame_from_axes
from simwarp.core.types import WORLD, ModelError, Pose, PrescribedPosition, PrescribedSpeed, pose
from simwarp.model.builder import ModelBuilder

Array = npt.NDArray[np.float64]

PENDULUM_PERIOD: Final = 2.367842
"""Period of `pendulum()` [s], released horizontally: 4 sqrt(L/g) K(sin² 45°)."""

FLIP_INTERVAL: Final = 5.025929
"""Time between two flips of `dzhanibekov()` [s]."""

ANDREWS_INITIAL: Final = (
    -0.0617138900142764496, 0.0, 0.455279819163070380, 0.222668390165885884, 0.487364979543842550,
    -0.222668390165885884, 1.23054744454982119,
)  # fmt: skip
"""Andrews' angles β, Θ, γ, Φ, δ, Ω, ε at t = 0: add them to the first seven coordinates of `andrews()`."""

ANDREWS_REFERENCE: Final = (
    15.81077119629904, -15.75637105984298, 0.04082224013073101, -0.5347301163226948, 0.5244099658805304,
    0.5347301163226948, 1.048080741042263,
)  # fmt: skip
"""The same angles at t = 0.03 s; source: IVP test set, "Andrews' squeezing mechanism"."""


class FourBar(NamedTuple):
    """Lengths [m] and masses [kg] of a planar four-bar linkage."""

    ground: float = 0.94
    crank: float = 0.31
    coupler: float = 0.83
    rocker: float = 0.72
    crank_mass: float = 0.7
    coupler_mass: float = 1.9
    rocker_mass: float = 1.3


def dzhanibekov() -> ModelBuilder:
    """A free body spinning about its middle axis: it turns over every 5.025929 s. Inertia (1, 2, 3) kg·m²."""
    builder = ModelBuilder(gravity=(0.0, 0.0, 0.0))
    builder.add_body("body", mass=1.0, inertia=(1.0, 2.0, 3.0), omega=(0.01, 5.0, 0.01))
    return builder


def pendulum(*, length: float = 1.0, mass: float = 1.0) -> ModelBuilder:
    """A mass on a massless arm, released horizontally from +X: q [rad] grows as it falls.

    The rotational inertia is 1e-6 m L²: it lengthens the period by 5e-7 of itself.
    """
    builder = ModelBuilder()
    small = 1e-6 * mass * length**2
    bob = builder.add_body("bob", mass=mass, inertia=(small, small, small), pose=pose((length, 0.0, 0.0)))
    builder.add_joint_revolute("pivot", WORLD, bob, axis=(0.0, 1.0, 0.0), anchor=(0.0, 0.0, 0.0))
    return builder


def double_pendulum() -> ModelBuilder:
    """Two uniform rods, 1 m and 1 kg each, hinged about +Y, released along +X. Source: recorded Chrono run d."""
    builder = ModelBuilder()
    parent = WORLD
    for k in range(2):
        rod = builder.add_body(
            f"rod{k + 1}", mass=1.0, inertia=(0.001, 1.0 / 12.0, 1.0 / 12.0), pose=pose((k + 0.5, 0.0, 0.0))
        )
        builder.add_joint_revolute(f"hinge{k + 1}", parent, rod, axis=(0.0, 1.0, 0.0), anchor=(float(k), 0.0, 0.0))
        parent = rod
    return builder


def chain(
    links: int = 20,
    *,
    length: float = 0.2,
    mass: float = 0.5,
    joint: Literal["revolute", "spherical"] = "revolute",
    tip_mass: float = 0.0,
) -> ModelBuilder:
    """Rods hanging from the world, released along +X; hinges about +Y, or ball joints.

    Args:
        links: number of rods.
        length: of one rod [m].
        mass: of one rod [kg].
        joint: between the links.
        tip_mass: of a ball of radius length / 4 welded to the free end [kg]; none when 0.
    """
    builder = ModelBuilder()
    parent = WORLD
    for k in range(links):
        at = (k * length, 0.0, 0.0)
        rod = _rod(builder, f"link{k}", at, ((k + 1) * length, 0.0, 0.0), mass)
        if joint == "revolute":
            builder.add_joint_revolute(f"hinge{k}", parent, rod, axis=(0.0, 1.0, 0.0), anchor=at)
        else:
            builder.add_joint_spherical(f"ball{k}", parent, rod, anchor=at)
        parent = rod
    if tip_mass > 0.0:
        tip = (links * length, 0.0, 0.0)
        inertia = (0.4 * tip_mass * (0.25 * length) ** 2,) * 3
        weight = builder.add_body("tip", mass=tip_mass, inertia=inertia, pose=pose(tip))
        builder.add_joint_fixed("weld", parent, weight, anchor=tip)
    return builder


def slider_crank(*, speed: float | None = 2.0 * math.pi) -> ModelBuilder:
    """Crank 0.5 m 1 kg, rod 1.5 m 2 kg, slider 3 kg; the crank turns from +X towards +Z. Source: Chrono run d.

    With the motor, slider x = r cos wt + sqrt(l² - (r sin wt)²). Joint order: motor, crank pin, wrist pin, guide.

    Args:
        speed: that a prescribed motor holds [rad/s]; None leaves the crank free, started at 2π rad/s.
    """
    r, length = 0.5, 1.5
    start = 2.0 * math.pi if speed is None else speed
    rate = r * start / length
    builder = ModelBuilder()
    down = (0.0, -1.0, 0.0)  # rotation about -Y turns +X towards +Z
    crank = builder.add_body(
        "crank", mass=1.0, inertia=(0.001, r**2 / 12.0, r**2 / 12.0), pose=pose((0.5 * r, 0.0, 0.0)),
        velocity=(0.0, 0.0, 0.5 * r * start), omega=(0.0, -start, 0.0),
    )  # fmt: skip
    rod = builder.add_body(
        "rod", mass=2.0, inertia=(0.002, 2.0 * length**2 / 12.0, 2.0 * length**2 / 12.0),
        pose=pose((r + 0.5 * length, 0.0, 0.0)), velocity=(0.0, 0.0, 0.5 * r * start), omega=(0.0, rate, 0.0),
    )  # fmt: skip
    slider = builder.add_body("slider", mass=3.0, inertia=(0.02, 0.02, 0.02), pose=pose((r + length, 0.0, 0.0)))
    drive = None if speed is None else PrescribedSpeed(table=((0.0, 1.0), (speed, speed)))
    builder.add_joint_revolute("motor", WORLD, crank, axis=down, anchor=(0.0, 0.0, 0.0), drive=drive)
    builder.add_joint_revolute("crank_pin", crank, rod, axis=down, anchor=(r, 0.0, 0.0))
    builder.add_joint_revolute("wrist_pin", rod, slider, axis=down, anchor=(r + length, 0.0, 0.0))
    builder.add_joint_prismatic("guide", WORLD, slider, axis=(1.0, 0.0, 0.0))
    return builder


def four_bar(*, angle: float = 0.9, speed: float = 12.0, sizes: FourBar = FourBar()) -> ModelBuilder:  # noqa: B008
    """A planar Grashof crank-rocker of four hinges about -Y: three of its 20 rows are redundant; gravity acts.

    The ground pins are O = (0, 0, 0) and (ground, 0, 0); the crank starts at `angle` [rad] with `speed` [rad/s] and
    runs free. Shortest plus longest is less than the other two: no configuration is singular.
    """
    builder = ModelBuilder()
    (_, rocker_angle), (coupler_rate, rocker_rate) = four_bar_angles(sizes, angle, speed)
    o = np.zeros(3)
    a = sizes.crank * _direction(angle)
    c = np.array([sizes.ground, 0.0, 0.0])
    b = c + sizes.rocker * _direction(rocker_angle)
    down = (0.0, -1.0, 0.0)
    va, rest = _spin(speed, a - o), np.zeros(3)
    crank = _rod(builder, "crank", o, a, sizes.crank_mass, omega=(0.0, -speed, 0.0), start_velocity=rest)
    coupler = _rod(builder, "coupler", a, b, sizes.coupler_mass, omega=(0.0, -coupler_rate, 0.0), start_velocity=va)
    rocker = _rod(builder, "rocker", c, b, sizes.rocker_mass, omega=(0.0, -rocker_rate, 0.0), start_velocity=rest)
    builder.add_joint_revolute("crank_pivot", WORLD, crank, axis=down, anchor=o)
    builder.add_joint_revolute("crank_pin", crank, coupler, axis=down, anchor=a)
    builder.add_joint_revolute("rocker_pivot", WORLD, rocker, axis=down, anchor=c)
    builder.add_joint_revolute("rocker_pin", coupler, rocker, axis=down, anchor=b)
    return builder


def four_bar_angles(
    sizes: FourBar, angle: float, speed: float = 0.0
) -> tuple[tuple[float, float], tuple[float, float]]:
    """(coupler, rocker) angles [rad] from +X towards +Z and their rates [rad/s], for a crank angle and speed."""
    ax, az = sizes.crank * math.cos(angle), sizes.crank * math.sin(angle)
    dx, dz = sizes.ground - ax, -az
    distance = math.hypot(dx, dz)
    cosine = (sizes.coupler**2 + distance**2 - sizes.rocker**2) / (2.0 * sizes.coupler * distance)
    coupler = math.atan2(dz, dx) + math.acos(cosine)
    bx, bz = ax + sizes.coupler * math.cos(coupler), az + sizes.coupler * math.sin(coupler)
    rocker = math.atan2(bz, bx - sizes.ground)
    # the two links meet: their ends move together
    sine = math.sin(rocker - coupler)
    coupler_rate = speed * sizes.crank * math.sin(angle - rocker) / (sizes.coupler * sine)
    rocker_rate = speed * sizes.crank * math.sin(angle - coupler) / (sizes.rocker * sine)
    return (coupler, rocker), (coupler_rate, rocker_rate)


def floating_tree(seed: int = 1, bodies: int = 10) -> ModelBuilder:
    """A floating random tree without gravity: hinges, ball joints, universal joints and slides; at rest.

    Coordinates start with the six of a FREE joint, "root".

    Args:
        seed: everything follows from it.
        bodies: number of bodies.
    """
    rng = np.random.default_rng(seed)
    builder = ModelBuilder(gravity=(0.0, 0.0, 0.0))
    for k in range(bodies):
        mass = float(rng.uniform(0.5, 3.0))
        a, b = rng.uniform(0.01, 0.03, 2) * mass
        builder.add_body(
            f"body{k}", mass=mass, inertia=(a, b, float(rng.uniform(max(a, b), a + b))),
            pose=pose(0.5 * rng.normal(size=3), rng.normal(size=4)),
        )  # fmt: skip
    builder.add_joint_free("root", 0)
    for k in range(1, bodies):
        parent = int(rng.integers(max(0, k - 3), k))
        ends = (f"joint{k}", parent, k)
        anchor = 0.5 * (builder.bodies[parent].pose.position + builder.bodies[k].pose.position)
        axis = rng.normal(size=3)
        if k % 4 == 0:
            builder.add_joint_spherical(*ends, anchor=anchor)
        elif k % 4 == 1:
            builder.add_joint_prismatic(*ends, anchor=anchor, axis=axis)
        elif k % 4 == 2:
            builder.add_joint_revolute(*ends, anchor=anchor, axis=axis)
        else:
            other = np.cross(axis, rng.normal(size=3))
            builder.add_joint_universal(*ends, anchor=anchor, axis0=axis, axis1=other)
    return builder


def bricard() -> ModelBuilder:
    """Bricard's mechanism: five 1 m, 1 kg rods and six hinges along a hexagon of cube edges; gravity is -Y.

    Thirty rows on thirty coordinates, and yet one degree of freedom: one row is redundant in every configuration.
    Source: Bricard (1897); IFToMM multibody benchmark "Bricard's mechanism". Released at rest.
    """
    builder = ModelBuilder(gravity=(0.0, -9.81, 0.0))
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 1], [0, 1, 1], [0, 0, 1]], float)
    # each hinge is perpendicular to both rods that meet in it
    axes = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 0]], float)
    rods = [_rod(builder, f"rod{k}", corners[k], corners[k + 1], 1.0) for k in range(5)]
    chain_of_bodies = [WORLD, *rods, WORLD]
    for k in range(6):
        parent, child = chain_of_bodies[k], chain_of_bodies[k + 1]
        if child == WORLD:
            parent, child = child, parent
        builder.add_joint_revolute(f"hinge{k}", parent, child, axis=axes[k], anchor=corners[k])
    return builder


def andrews() -> ModelBuilder:
    """Andrews' squeezer: seven planar bodies, three closed loops, a spring, 0.033 N·m on the crank; no gravity.

    The plane is XY, hinges are about +Z. The first seven coordinates are β, Θ, γ, Φ, δ, Ω, ε less `ANDREWS_INITIAL`;
    then the three closing hinges, then the length of the spring. It runs through 30 ms: steps of 10 µs or so.
    Source: IVP test set.
    """
    builder = ModelBuilder(gravity=(0.0, 0.0, 0.0))
    points = _andrews_points(ANDREWS_INITIAL)
    masses = (0.04325, 0.00365, 0.02373, 0.00706, 0.07050, 0.00706, 0.05498)
    inertias = (2.194e-6, 4.410e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5)
    bodies = [
        builder.add_body(f"K{k + 1}", mass=masses[k], inertia=(inertias[k],) * 3, pose=pose(points[f"K{k + 1}"]))
        for k in range(7)
    ]
    k1, k2, k3, k4, k5, k6, k7 = bodies
    hinges = (
        ("O", WORLD, k1), ("P", k1, k2), ("B", WORLD, k3), ("E", k5, k4), ("A", WORLD, k5), ("H", k7, k6),
        ("A", WORLD, k7), ("X", k2, k3), ("X", k2, k4), ("X", k2, k6),
    )  # fmt: skip
    names = ("beta", "theta", "gamma", "phi", "delta", "omega", "epsilon", "close3", "close4", "close6")
    for name, (point, parent, child) in zip(names, hinges, strict=True):
        builder.add_joint_revolute(
            name, parent, child, axis=(0.0, 0.0, 1.0), anchor=points[point], preload=0.033 if name == "beta" else 0.0
        )
    builder.add_spring("spring", WORLD, k3, anchor0=points["C"], anchor1=points["D"], stiffness=4530.0, rest=0.07785)
    return builder


def linkage(*, speed: float = 10.0, wheel_speed: float = 30.0) -> ModelBuilder:
    """A vehicle without tires or ground: 20 bodies, 28 joints, 106 rows, 19 of which close loops; no gravity.

    A free chassis, four double wishbones (upper arm, lower arm, upright, wheel; tie rod as a distance) and a steering
    trapezium (Pitman arm, link, idler) whose Pitman arm follows `joint_target_q`: 105 joint rows and one prescribed
    row. Loops: per corner the upper ball (3) and the tie rod (1), and the ball between link and idler (3). A spring
    and a damper act in every lower arm's hinge, preloaded so that it swings. X forward, Y left, Z up.

    Args:
        speed: of the whole along +X [m/s], with a slow roll, pitch and yaw of (0.3, -0.2, 0.5) rad/s.
        wheel_speed: of the wheels against their uprights [rad/s].
    """
    builder = ModelBuilder(gravity=(0.0, 0.0, 0.0))
    motion = (np.array([speed, 0.0, 0.0]), np.array([0.3, -0.2, 0.5]))
    chassis = _moving_body(builder, "chassis", 2000.0, (600.0, 2200.0, 2500.0), (0.0, 0.0, 0.0), motion)
    arm = _moving_body(builder, "pitman", 1.6, (0.01, 0.01, 0.02), (1.62, 0.36, -0.1), motion)
    link = _moving_body(builder, "link", 3.7, (0.16, 0.01, 0.16), (1.55, 0.0, -0.1), motion)
    idler = _moving_body(builder, "idler", 1.4, (0.01, 0.01, 0.02), (1.62, -0.36, -0.1), motion)
    up = (0.0, 0.0, 1.0)
    builder.add_joint_revolute(
        "pitman_pivot", chassis, arm, axis=up, anchor=(1.69, 0.36, -0.1), drive=PrescribedPosition()
    )
    builder.add_joint_universal("pitman_link", arm, link, anchor=(1.55, 0.36, -0.1), axis0=up, axis1=(1.0, 0.0, 0.0))
    builder.add_joint_revolute("idler_pivot", chassis, idler, axis=up, anchor=(1.69, -0.36, -0.1))
    builder.add_joint_spherical("idler_link", idler, link, anchor=(1.55, -0.36, -0.1))
    for front, left in ((True, True), (True, False), (False, True), (False, False)):
        _corner(builder, front, left, chassis, link if front else chassis, motion, wheel_speed)
    return builder


# ---- parts ---------------------------------------------------------------------------------------------------------


def _corner(
    builder: ModelBuilder, front: bool, left: bool, chassis: int, rack: int, motion: tuple[Array, Array], spin: float
) -> None:
    """One double wishbone: four bodies, five joints and a tie rod; `rack` holds the tie rod's inner end."""
    x, side = (1.65 if front else -1.65), (1.0 if left else -1.0)
    name = ("front" if front else "rear") + ("_left" if left else "_right")

    def at(dx: float, y: float, z: float) -> Array:
        return np.array([x + dx, side * y, z])

    lower = _moving_body(builder, f"{name}_lower", 16.4, (0.24, 0.18, 0.4), at(0.0, 0.5, -0.18), motion)
    upper = _moving_body(builder, f"{name}_upper", 5.8, (0.06, 0.03, 0.08), at(0.0, 0.6, 0.1), motion)
    upright = _moving_body(builder, f"{name}_upright", 36.0, (0.55, 0.5, 0.3), at(0.0, 0.82, -0.04), motion)
    spindle = (0.0, 1.0, 0.0)
    wheel = _moving_body(
        builder, f"{name}_wheel", 45.0, (1.1, 1.9, 1.1), at(0.0, 0.91, -0.04), motion, extra=(0.0, spin, 0.0)
    )
    hinge = (1.0, 0.0, 0.0)
    # 60 kN/m and 4 kN·s/m at the ball, 0.44 m out; the preload starts the swing
    builder.add_joint_revolute(
        f"{name}_lower_hinge", chassis, lower, axis=hinge, anchor=at(0.0, 0.35, -0.16),
        stiffness=12000.0, damping=600.0, preload=side * 900.0,
    )  # fmt: skip
    builder.add_joint_revolute(f"{name}_upper_hinge", chassis, upper, axis=(1.0, 0.0, 0.09), anchor=at(0.0, 0.45, 0.1))
    builder.add_joint_spherical(f"{name}_lower_ball", lower, upright, anchor=at(0.02, 0.79, -0.2))
    builder.add_joint_spherical(f"{name}_upper_ball", upper, upright, anchor=at(-0.02, 0.75, 0.1))
    builder.add_joint_revolute(f"{name}_spindle", upright, wheel, axis=spindle, anchor=at(0.0, 0.91, -0.04))
    inner, outer = ((-0.1, 0.36, -0.1), (-0.13, 0.8, -0.09)) if front else ((-0.2, 0.38, -0.12), (-0.2, 0.8, -0.1))
    builder.add_joint_distance(f"{name}_tie_rod", rack, upright, anchor0=at(*inner), anchor1=at(*outer))


def _moving_body(
    builder: ModelBuilder,
    name: str,
    mass: float,
    inertia: tuple[float, float, float],
    position: Array | tuple[float, float, float],
    motion: tuple[Array, Array],
    extra: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> int:
    """A body carried along by the rigid motion (velocity of the origin, omega), turning by `extra` on top."""
    point = np.asarray(position, float)
    velocity, omega = motion
    return builder.add_body(
        name, mass=mass, inertia=inertia, pose=pose(point), velocity=velocity + np.cross(omega, point),
        omega=omega + np.asarray(extra),
    )  # fmt: skip


def _direction(angle: float) -> Array:
    """Unit vector in the XZ plane, from +X towards +Z."""
    return np.array([math.cos(angle), 0.0, math.sin(angle)])


def _spin(speed: float, arm: Array) -> Array:
    """Velocity [m/s] of the end of `arm` turning at `speed` [rad/s] from +X towards +Z."""
    return np.cross(np.array([0.0, -speed, 0.0]), arm)


def _rod(
    builder: ModelBuilder,
    name: str,
    start: Array | tuple[float, float, float],
    end: Array | tuple[float, float, float],
    mass: float,
    *,
    omega: tuple[float, float, float] = (0.0, 0.0, 0.0),
    start_velocity: Array | None = None,
) -> int:
    """A uniform round rod, its radius 1/50 of its length, with body x along it."""
    p, q = np.asarray(start, float), np.asarray(end, float)
    length = float(np.linalg.norm(q - p))
    if length < 1e-9:
        raise ModelError(f"rod '{name}': start and end must be apart, got {p.tolist()} twice; move one")
    along = (q - p) / length
    helper = np.array([0.0, 1.0, 0.0]) if abs(along[1]) < 0.9 else np.array([0.0, 0.0, 1.0])
    helper = helper - (helper @ along) * along
    rotation = frame_from_axes(f"rod '{name}'", along, helper)
    axial = 0.5 * mass * (length / 50.0) ** 2
    across = mass * length**2 / 12.0 + 0.5 * axial
    velocity = np.zeros(3) if start_velocity is None else start_velocity
    return builder.add_body(
        name, mass=mass, inertia=(axial, across, across), pose=Pose(0.5 * (p + q), rotation),
        velocity=velocity + np.cross(np.asarray(omega, float), 0.5 * (q - p)), omega=omega,
    )  # fmt: skip


def _andrews_points(q: tuple[float, ...]) -> dict[str, Array]:
    """Joints (letters) and centres of mass (K1..K7) of Andrews' squeezer at its seven angles."""
    beta, theta, gamma, phi, delta, omega, epsilon = q
    d, da, e, ea, rr, ra = 0.028, 0.0115, 0.02, 0.01421, 0.007, 0.00092
    sa, sb, sc, sd, ta, tb = 0.01874, 0.01043, 0.018, 0.02, 0.02308, 0.00916
    u, ua, ub, zf, zt, fa = 0.04, 0.01228, 0.00449, 0.02, 0.04, 0.01421

    def turned(along: float, across: float, angle: float) -> Array:
        c, s = math.cos(angle), math.sin(angle)
        return np.array([along * c - across * s, along * s + across * c, 0.0])

    a, b, c = np.array([[-0.06934, -0.00227, 0.0], [-0.03635, 0.03273, 0.0], [0.014, 0.072, 0.0]])
    p, end = turned(rr, 0.0, beta), a + turned(zt, 0.0, delta)
    high = a + turned(0.0, -u, epsilon)
    return {
        "O": np.zeros(3), "A": a, "B": b, "C": c, "P": p, "E": end, "H": high,
        "X": p - turned(d, 0.0, beta + theta),
        "D": b + turned(sd, -sc, gamma),
        "K1": turned(ra, 0.0, beta),
        "K2": p - turned(da, 0.0, beta + theta),
        "K3": b + turned(sb, -sa, gamma),
        "K4": end + turned(0.0, -(e - ea), phi + delta),
        "K5": a + turned(ta, tb, delta),
        "K6": high + turned(zf - fa, 0.0, omega + epsilon),
        "K7": a + turned(-ub, -ua, epsilon),
    }  # fmt: skip
