"""One evaluation of a belt's forces in float64: tangents by angles, tension's forces by differences of the length.

The plane of a belt has x towards the sprocket and z up, from the track's origin, in axes of the chassis.
"""

import dataclasses
import math
from typing import Any

import numpy as np

STEP = 1e-6
"""Of differences [m or rad]."""
SPAN, WHEEL, SPROCKET, IDLER = range(4)
"""Kinds of points."""
NORMAL = np.array([0.0, 0.0, 1.0])
"""Of the ground."""
ROAD = 0.9
"""Its friction."""


@dataclasses.dataclass
class Shape:
    """A belt around its wheels.

    Attributes:
        forward: 1 with the sprocket in front.
        hinges, arms: (n, 2) of the wheels' arms; from the hinge to the wheel as built [m].
        senses: (n,) 1: the arm's coordinate turns from z to x.
        radii: (n + 2,) of sprocket, wheels, idler, up to the pins [m].
        idler: (2,) as built [m].
        slide: (2,) direction of its coordinate.
        length, stretch: of the belt [m, m/N].
        force, stiffness, damping: of the tensioner, against its coordinate [N, N/m, N·s/m].
        depth: of the ground's side below the pins [m].
    """

    forward: float
    hinges: np.ndarray
    arms: np.ndarray
    senses: np.ndarray
    radii: np.ndarray
    idler: np.ndarray
    slide: np.ndarray
    length: float
    stretch: float
    force: float
    stiffness: float
    damping: float
    depth: float

    def centers(self, angles, place):
        """(n + 2, 2) of circles."""
        turned = [
            hinge + np.array([[math.cos(a), math.sin(a)], [-math.sin(a), math.cos(a)]]) @ arm
            for hinge, arm, a in zip(self.hinges, self.arms, self.senses * angles, strict=True)
        ]
        return np.array([np.zeros(2), *turned, self.idler + place * self.slide])

    def headings(self, centers):
        """Directions of the straight parts, angles from x towards z: each circle to the next one."""
        found = []
        for k in range(len(centers)):
            other = (k + 1) % len(centers)
            way = centers[other] - centers[k]
            lean = math.asin((self.radii[k] - self.radii[other]) / math.hypot(*way))
            found.append(math.atan2(way[1], way[0]) - lean)
        return np.array(found)

    def around(self, centers):
        """Length of the way around [m]: straight parts and arcs, clockwise."""
        headings, total = self.headings(centers), 0.0
        for k in range(len(centers)):
            other = (k + 1) % len(centers)
            along = np.array([math.cos(headings[k]), math.sin(headings[k])])
            total += (centers[other] - centers[k]) @ along
            turn = headings[k - 1] - headings[k]
            turn = (turn + math.pi) % (2.0 * math.pi) - math.pi
            if k in (0, len(centers) - 1) and turn < -0.5 * math.pi:
                turn += 2.0 * math.pi
            total += self.radii[k] * turn
        return total

    def lever(self, angles, place):
        """Way around per coordinate of the idler, negative: what it gives back."""
        ahead, behind = (self.around(self.centers(angles, place + d)) for d in (STEP, -STEP))
        return (behind - ahead) / (2.0 * STEP)

    def tension_at(self, angles, place):
        """Of a resting tensioner [N]."""
        return (self.force + self.stiffness * place) / self.lever(angles, place)

    def solve(self, angles, bulge=0.0):
        """Coordinate of the idler at which the belt has its length, by halving [m]."""

        def excess(place):
            tension = self.tension_at(angles, place)
            return self.around(self.centers(angles, place)) + bulge - self.length - self.stretch * tension

        low, high = -0.3, 0.12
        rising = excess(high) > excess(low)
        assert excess(low) * excess(high) < 0.0
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if (excess(middle) > 0.0) == rising else (middle, high)
        return 0.5 * (low + high)

    def gradient(self, angles, place):
        """(n,) way around per angle of each arm [m/rad]."""
        found = np.zeros(len(angles))
        for k in range(len(angles)):
            move = np.zeros(len(angles))
            move[k] = STEP
            ahead, behind = (self.around(self.centers(angles + d, place)) for d in (move, -move))
            found[k] = (ahead - behind) / (2.0 * STEP)
        return found


def tension_of(shape, angles, rates, place):
    """Tension of moving wheels [N]: the idler follows them without delay."""
    lever = shape.lever(angles, place)
    slope = lever + shape.stretch * shape.stiffness / lever
    speed = shape.gradient(angles, place) @ rates / slope
    return max((shape.force + shape.stiffness * place + shape.damping * speed) / lever, 0.0)


def point_places(shape, angles, place, points):
    """(N, 2) places on the ground's side of points (kind, place, share) [m]."""
    centers = shape.centers(angles, place)
    headings = shape.headings(centers)
    last = len(centers) - 1

    def outward(angle):
        return np.array([-math.sin(angle), math.cos(angle)])

    found = []
    for kind, at, share in points:
        if kind == SPAN:
            along = np.array([math.cos(headings[at]), math.sin(headings[at])])
            out = outward(headings[at])
            start = centers[at] + shape.radii[at] * out
            length = (centers[(at + 1) % (last + 1)] - centers[at]) @ along
            found.append(start + share * length * along + shape.depth * out)
            continue
        if kind == WHEEL:
            before, after = headings[at - 1], headings[at]
            rising, falling = math.sin(before) > 0.0, math.sin(after) < 0.0
            level = before if rising and not falling else after if falling and not rising else math.pi
            out = outward(level)
        else:
            lower, ahead = (headings[0], (1.0, 0.0)) if kind == SPROCKET else (headings[last - 1], (-1.0, 0.0))
            out = (1.0 - share) * outward(lower) + share * np.array(ahead)
            out /= np.linalg.norm(out)
        found.append(centers[at] + (shape.radii[at] + shape.depth) * out)
    return np.array(found)


def press_bekker(reach, backing, layers, deepest, stiffness, exponent, elastic):
    """Force [N], deepest sinkage [m] and pressed area [m²] of a soil behind a spring, by halving.

    Args:
        layers: (area, height) of pads at heights above the lowest ones [m², m].
    """

    def pressure(z, old):
        limit = stiffness * old**exponent
        if z <= old:
            return max(elastic * (z - old) + limit, 0.0) if z > 0.0 else 0.0
        return min(stiffness * z**exponent, limit + elastic * (z - old))

    def parts(z):
        return np.array([area * pressure(z - height, max(deepest - height, 0.0)) for area, height in layers])

    low, high = 0.0, max(reach, 0.0)
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if parts(middle).sum() < backing * (reach - middle) else (low, middle)
    found = parts(0.5 * (low + high))
    touched = sum(area for (area, _), force in zip(layers, found, strict=True) if force > 0.0)
    return found.sum(), max(0.5 * (low + high), deepest), touched


@dataclasses.dataclass
class BeltForces:
    """A belt above the plane z = 0 in one state; `run` leaves force, torque, arms, shaft and tension.

    Attributes:
        shape: its wheels.
        law: parameters by name.
        soil: None on hard ground.
        dt: step [s].
        x, axes, v, w: place, axes (columns) and motion of the chassis.
        origin: of the track from the chassis' centre of mass, in its axes [m].
        angles, rates: of the arms.
        speed: of the belt [m/s].
        place: coordinate of the idler [m].
        loss_way: of the dry resistance [m].
        lift, shear, sinkage: (N,), (N, 2), (N,) of points, before and after.
        points: kind, place and share of each.
    """

    shape: Shape
    law: dict
    soil: Any
    dt: float
    x: np.ndarray
    axes: np.ndarray
    v: np.ndarray
    w: np.ndarray
    origin: np.ndarray
    angles: np.ndarray
    rates: np.ndarray
    speed: float
    place: float
    loss_way: float
    lift: np.ndarray
    shear: np.ndarray
    sinkage: np.ndarray
    points: list

    def __post_init__(self):
        shape, angles = self.shape, self.angles
        self.headings = shape.headings(shape.centers(angles, self.place))
        self.tension = tension_of(shape, angles, self.rates, self.place)
        places = point_places(shape, angles, self.place, self.points)
        self.gaps = np.linalg.norm(np.diff(places, axis=0), axis=1)
        flat = np.stack([shape.forward * places[:, 0], np.zeros(len(places)), places[:, 1]], axis=1)
        self.places = (self.origin + flat) @ self.axes.T
        moves = STEP * np.eye(len(angles))
        self.levers = np.array([
            (shape.centers(angles + d, self.place) - shape.centers(angles - d, self.place))[k + 1] / (2.0 * STEP)
            for k, d in enumerate(moves)
        ])  # fmt: skip
        self.motion = np.zeros((len(angles) + 2, 2))
        self.motion[1:-1] = self.levers * self.rates[:, None]
        self.pulls, self.areas, self.arms = (np.zeros(n) for n in (len(self.points), len(self.points), len(angles)))

    def run(self):
        count, law = len(self.points), self.law
        self.loads = np.zeros(len(self.angles))
        self.onwards = 1 if self.shape.forward * self.speed >= 0.0 else -1
        self.force, self.torque = np.zeros(3), np.zeros(3)
        for i in range(count)[:: self.onwards]:
            there = self.point(i)
            self.force = self.force + there
            self.torque = self.torque + np.cross(self.places[i], there)
        self.pull_wheels()
        way = np.clip(self.loss_way + self.dt * self.speed, -law["loss_way"], law["loss_way"])
        pulled = self.pulls.sum()
        dry = law["loss_dry"] * self.tension + law["loss_rolling"] * self.loads.sum()
        dry += law["loss_sprocket"] * max(self.tension - 0.5 * pulled, 0.0)
        viscous = law["loss_linear"] * self.speed + law["loss_square"] * abs(self.speed) * self.speed
        loss = dry * way / law["loss_way"] + self.tension * viscous
        self.shaft = law["pitch_radius"] * (-loss - self.shape.forward * pulled)
        return self

    def near(self, i):
        """Ways to the points before and after, and what the point stands for [m]."""
        before = self.gaps[i - 1] if i > 0 else 1e-3
        after = self.gaps[i] if i < len(self.gaps) else 1e-3
        length = after if i == 0 else before if i == len(self.gaps) else 0.5 * (before + after)
        return before, after, length

    def velocity(self, arm):
        return self.v + np.cross(self.w, arm)

    def rate(self, i):
        """At which a point comes down [m/s]."""
        kind, at, share = self.points[i]
        swing = self.motion[at]
        if kind == SPAN:
            swing = (1.0 - share) * self.motion[at] + share * self.motion[at + 1]
        own = self.axes @ np.array([self.shape.forward * swing[0], 0.0, swing[1]])
        return -(self.velocity(self.places[i]) + own) @ NORMAL

    def load(self, i):
        """Normal force of a point [N]; lifts the belt, and sinks into soil."""
        (kind, _, share), law = self.points[i], self.law
        before, after, length = self.near(i)
        count = len(self.points)
        backing = self.tension / before + self.tension / after + 1.0
        line = (
            self.tension / before * self.lift[max(i - 1, 0)] + self.tension / after * self.lift[min(i + 1, count - 1)]
        )
        if kind != SPAN or share in (0.0, 1.0):
            backing += 1.0 / law["wheel_sink"]
        line /= backing
        reach, self.lift[i] = -(self.x + self.places[i])[2] - line, line
        if self.soil is None:
            ground = law["ground_stiffness"] * length
            k = ground * backing / (ground + backing)
            elastic, damping = k * reach, law["ground_damping"] * k
        else:
            elastic, area = self.press_soil(i, reach, backing)
            damping = area * self.soil.damping * backing / (backing + area * self.soil.elastic)
        if elastic <= 0.0:
            return 0.0
        self.lift[i] = line + elastic / backing
        return max(elastic + damping * self.rate(i), 0.0)

    def press_soil(self, i, reach, backing):
        """The same of soil, without its damping; what is sunk stays behind."""
        before, after, length = self.near(i)
        moved = self.shape.forward * (self.velocity(self.places[i]) @ self.axes[:, 0]) * self.dt
        source, way = (i - 1, before) if moved >= 0.0 else (i + 1, after)
        share = abs(moved) / way
        rut = self.sinkage[source] if 0 <= source < len(self.points) else 0.0
        soil, law = self.soil, self.law
        layers = [(law["width"] * length, 0.0), (law["side_width"] * length, law["side_height"])]
        force, self.sinkage[i], self.areas[i] = press_bekker(
            reach, backing, layers, (self.sinkage[i] + share * rut) / (1.0 + share),
            soil.k_phi + soil.k_c / law["patch"], soil.exponent, soil.elastic,
        )  # fmt: skip
        return force, self.areas[i]

    def slide(self, i, axis, across):
        """Way that a point has slid [m], kept within what counts."""
        before, after, _ = self.near(i)
        source, count = i - self.onwards, len(self.points)
        step = abs(self.speed) * self.dt / (before if source < i else after)
        arriving = self.shear[source] if 0 <= source < count else np.zeros(2)
        way = self.places[min(max(source, 0), count - 1)] - self.places[i]
        midways = 0.5 * abs(self.speed) / (abs(self.speed) + 0.05)
        v = self.velocity(self.places[i] + midways * way)
        slid = self.dt * np.array([v @ axis - self.speed, v @ across])
        shear = (self.shear[i] + slid + step * arriving) / (1.0 + step)
        most = self.law["shear_length"] if self.soil is None else 6.0 * self.soil.shear_length
        self.shear[i] = shear * min(1.0, most / max(np.linalg.norm(shear), 1e-9))
        return self.shear[i]

    def pull(self, i, load, slip):
        """Shear force of a point: forwards, to the left [N]."""
        law, soil, shear = self.law, self.soil, self.shear[i]
        if soil is None:
            limit = min(ROAD, law["friction"]) * load
            pull = -limit / law["shear_length"] * (shear + law["shear_damping"] * slip)
        else:
            limit = soil.cohesion * self.areas[i] + load * math.tan(soil.friction_angle)
            rest = math.exp(-np.linalg.norm(shear) / soil.shear_length)
            pull = -limit / soil.shear_length * rest * law["shear_damping"] * slip
            pull = pull - limit * (1.0 - rest) * shear / np.linalg.norm(shear)
        return pull * min(1.0, limit / np.linalg.norm(pull))

    def push(self, i):
        """Direction of a point's normal force: the ground's normal, on soil the belt's."""
        if self.soil is None:
            return NORMAL
        kind, at, _ = self.points[i]
        heading = self.headings[0 if kind == SPROCKET else -2 if kind == IDLER else at]
        if kind == WHEEL:
            both = self.headings[[at - 1, at]]
            heading = math.atan2(np.sin(both).sum(), np.cos(both).sum())
        before, after, _ = self.near(i)
        risen = self.lift[min(i + 1, len(self.lift) - 1)] - self.lift[max(i - 1, 0)]
        heading -= math.atan(risen / (before + after))
        return self.axes @ np.array([self.shape.forward * math.sin(heading), 0.0, -math.cos(heading)])

    def point(self, i):
        """Force of the ground on a point, world axes [N]; and its share in the wheels' arms."""
        load = self.load(i)
        if load <= 0.0:
            self.shear[i] = 0.0
            return np.zeros(3)
        ahead, forward = self.axes[:, 0], self.shape.forward
        axis = ahead - (ahead @ NORMAL) * NORMAL
        axis /= np.linalg.norm(axis)
        across = np.cross(NORMAL, axis)
        v = self.velocity(self.places[i])
        self.slide(i, axis, across)
        pull = self.pull(i, load, np.array([v @ axis - self.speed, v @ across]))
        self.pulls[i] = forward * pull[0]
        push = self.push(i)
        in_plane = np.array([forward * (push @ ahead), push @ self.axes[:, 2]])
        kind, at, share = self.points[i]
        if kind in (SPAN, WHEEL):
            first, second = (1.0, 0.0) if kind == WHEEL else (1.0 - share, share)
            for circle, part in ((at, first), (at + 1, second)):
                if 1 <= circle <= len(self.arms):
                    self.loads[circle - 1] += part * load
                    self.arms[circle - 1] += part * load * in_plane @ self.levers[circle - 1]
        return load * push + pull[0] * axis + pull[1] * across

    def pull_wheels(self):
        """Torques of the tension on the arms: it falls from the idler on by what the ground pulls."""
        heads = np.stack([np.cos(self.headings), np.sin(self.headings)], axis=1)
        for i, (kind, at, _) in enumerate(self.points):
            if kind == WHEEL:
                there = max(self.tension - self.pulls[i + 1 :].sum() - 0.5 * self.pulls[i], 0.0)
                self.arms[at - 1] += there * self.levers[at - 1] @ (heads[at] - heads[at - 1])
