"""The understeer gradient of a vehicle on two axles from its parts: tires on a machine, axles on a bench, and statics.

Independent of any driving: the axle characteristics of handling theory. At a lateral acceleration a, each axle bears
its share of the side force, by the lever rule with the tires' trails; roll follows from the bench's roll stiffnesses
and roll centres and the tires' vertical stiffness, and gives the wheel loads and the roll steer. The slip angle of an
axle is the one at which both tires, each at its load, make that force. Then, with steer angles in the vehicle's axes,

    angle of the front wheels - l / R = alpha_rear - alpha_front + steer of the rear wheels

(slip angles positive where a wheel drifts to the left, so that they are negative in a turn to the left). Toe counts:
the more loaded tire pulls more its way. Tires are assumed to make no force by camber alone.
"""

from __future__ import annotations

import math

import numpy as np

from simwarp.vehicle.rigs import run_suspension_rig, tire_forces
from simwarp.vehicle.rigs.tire_rig import static_deflection
from simwarp.vehicle.spec.vehicle_spec import VehicleSpec

GRAVITY = 9.81
ANGLES = np.linspace(-0.08, 0.0, 41)
"""Slip angles at which tires are measured [rad]."""


class Axles:
    """What benches say of both axles.

    Attributes:
        wheelbase: [m].
        mass: [kg].
        height: of the centre of mass over the ground [m].
        share: (2,) of the weight.
        pitch: of the vehicle's frame, nose down, as it stands [rad].
        track: (2,) [m].
        loads: (2,) of each wheel as it stands [N].
        drag: (2,) force of a rolling tire backwards over its load.
        slip: (2,) slip ratio of the wheels: the front ones are pulled, the rear ones pull.
        tire_roll: (2,) roll stiffness of the tires [N·m/rad].
        spring_roll: (2,) of springs and anti-roll bar [N·m/rad].
        roll_centre: (2,) heights [m].
        toe: (2,) of each wheel as it stands, positive inwards [rad].
        roll_camber: (2,) lean of the wheels to the right per roll of the axle to the right, in the vehicle's frame.
        roll_steer: (2,) steer to the left per roll of the axle, positive where the left wheel is up.
    """

    def __init__(self, spec: VehicleSpec) -> None:
        runs = [run_suspension_rig(spec, axle, points=9, travel=0.01) for axle in (0, 1)]
        values, stand = [run.parameters() for run in runs], runs[0].loads
        self.spec, self.wheelbase, self.mass, self.height = spec, stand.wheelbase, stand.mass, stand.com_height
        level = stand.center_z - stand.loaded_radius
        self.pitch = math.atan2(level[0] - level[1], stand.wheelbase)
        # as the frame leans, its centre of mass moves forwards over the wheels' centres
        ahead = stand.com[0] - stand.axle_x[1] + self.pitch * (stand.com[2] - stand.center_z[1])
        self.share = np.array([ahead, stand.wheelbase - ahead]) / stand.wheelbase
        self.track = stand.track
        self.loads = 0.5 * self.mass * GRAVITY * self.share
        self.drag = np.array([drag(spec, axle, load) for axle, load in enumerate(self.loads)])
        pulled = self.drag[0] * self.loads[0]
        self.slip = np.array([-1.0, 1.0]) * pulled / [slip_stiffness(spec, axle, load) for axle, load in
                                                      enumerate(self.loads)]  # fmt: skip
        rate = [vertical_rate(spec, axle, load) for axle, load in enumerate(self.loads)]
        self.tire_roll = 0.5 * np.array(rate) * self.track**2
        self.spring_roll = np.array([math.degrees(each["roll_stiffness_Nm_per_deg"]) for each in values])
        self.roll_centre = 1e-3 * np.array([each["roll_centre_height_mm"] for each in values])
        self.roll_steer = np.array([each["roll_steer_deg_per_deg"] for each in values])
        self.roll_camber = np.array([each["roll_camber_deg_per_deg"] for each in values])
        # the bench loads its wheels without the lean of the frame
        up = (self.loads - stand.wheel_load) / np.array([1e3 * each["wheel_rate_N_per_mm"] for each in values])
        gain = np.array([each["toe_gain_deg_per_m"] for each in values])
        self.toe = np.radians([each["toe_deg"] for each in values] + gain * up)

    def roll(self) -> tuple[float, np.ndarray]:
        """Roll of the vehicle to the right and of each axle's springs, per lateral acceleration to the left [s²/m].

        Axles without mass: the tires' moment is that of the springs and of the side force at the roll centre.
        """
        tires, springs = self.tire_roll, self.spring_roll
        matrix = np.zeros((3, 3))
        matrix[0] = (tires.sum() - self.mass * GRAVITY * self.height, *-tires)
        for axle in (0, 1):
            matrix[1 + axle, 0] = tires[axle]
            matrix[1 + axle, 1 + axle] = -tires[axle] - springs[axle]
        moments = [self.mass * self.height, *(self.share * self.mass * self.roll_centre)]
        found = np.linalg.solve(matrix, moments)
        return float(found[0]), found[1:]


def vertical_rate(spec: VehicleSpec, axle: int, load: float) -> float:
    """Of a tire about a load [N/m]."""
    low, high = static_deflection(spec.axles[axle].tire, np.array([0.95, 1.05]) * load)
    return float(0.1 * load / (high - low))


def drag(spec: VehicleSpec, axle: int, load: float) -> float:
    """Of a tire that its hub pulls: its rolling moment over load and radius."""
    rolled = tire_forces(spec.axles[axle].tire, load=load)
    return abs(float(rolled.my)) / (load * (spec.axles[axle].tire.radius - float(rolled.deflection)))


def slip_stiffness(spec: VehicleSpec, axle: int, load: float) -> float:
    """Of a tire along its way, about free rolling [N]."""
    back, ahead = tire_forces(spec.axles[axle].tire, slip_ratio=[-1e-3, 1e-3], load=load).fx
    return float((ahead - back) / 2e-3)


def slip_angles(
    axles: Axles, axle: int, force: np.ndarray, transfer: np.ndarray, speed: float, friction: float
) -> tuple[np.ndarray, np.ndarray]:
    """(n,) slip angles [rad] at which an axle makes side forces (n,) [N], and the trail of its tires there [m].

    Args:
        axles: of the vehicle.
        axle: 0 or 1.
        force: to the left.
        transfer: (n,) load that goes from the left to the right wheel [N].
        speed: [m/s].
        friction: of the road.
    """
    tire, load = axles.spec.axles[axle].tire, axles.loads[axle]
    found, trails = [], []
    for wanted, moved in zip(force, transfer, strict=True):
        loads = np.array([[load - moved], [load + moved]])
        aside = ANGLES + np.array([[axles.toe[axle]], [-axles.toe[axle]]])
        both = tire_forces(
            tire, slip_ratio=axles.slip[axle], slip_angle=aside, load=loads, speed=speed, friction=friction
        )  # fmt: skip
        side, moment = both.fy.sum(axis=0), both.mz.sum(axis=0)
        angle = float(np.interp(wanted, side[::-1], ANGLES[::-1]))
        found.append(angle)
        trails.append(-float(np.interp(wanted, side[::-1], moment[::-1])) / wanted)
    return np.array(found), np.array(trails)


def understeer_gradient(
    spec: VehicleSpec, lateral: np.ndarray, speed: float, friction: float = 0.9
) -> dict[str, float]:
    """Slopes over lateral accelerations [m/s²] of what makes up the gradient, and their sum [rad/(m/s²)].

    Args:
        spec: of a vehicle on two axles whose rear one is not steered.
        lateral: (n,) at which it is reckoned, above 0.
        speed: of the tires [m/s].
        friction: of the road.
    """
    axles = Axles(spec)
    phi, springs = axles.roll()
    transfer = axles.tire_roll * (phi - springs) / axles.track
    base = axles.wheelbase
    trail = np.zeros((2, len(lateral)))
    angles = np.zeros((2, len(lateral)))
    # the outer wheels drag more: a moment against the turn
    against = float(np.sum(axles.drag * transfer * axles.track)) * lateral
    for _ in range(2):
        # side forces act behind the wheels by their trails
        span = base - trail[0] + trail[1]
        front = ((axles.share[0] * base + trail[1]) * axles.mass * lateral + against) / span
        forces = (front, axles.mass * lateral - front)
        for axle in (0, 1):
            angles[axle], trail[axle] = slip_angles(
                axles, axle, forces[axle], transfer[axle] * lateral, speed, friction
            )  # fmt: skip
    # the vehicle rolls to the right: the right wheel goes up. In the plane of the road wheels that lean steer by their
    # lean times the pitch, too
    lean = phi - springs + springs * (1.0 + axles.roll_camber)
    rear = -axles.roll_steer[1] * springs[1] - axles.pitch * lean[1]
    parts = {
        "tires": float(np.polyfit(lateral, angles[1] - angles[0], 1)[0]),
        "rear_steer": float(rear),
        "front_lean": float(axles.pitch * lean[0]),
    }
    return parts | {"gradient": sum(parts.values()), "roll": phi}
