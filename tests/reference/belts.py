"""One evaluation of a belt's forces in float64: tangents by angles, tension's forces by differences of the length.

The plane of a belt has x towards the sprocket and z up, from the track's origin, in axes of the chassis.
"""

import dataclasses
import math

import numpy as np

STEP = 1e-6
"""Of differences [m or rad]."""


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
        if kind == 0:
            along = np.array([math.cos(headings[at]), math.sin(headings[at])])
            out = outward(headings[at])
            start = centers[at] + shape.radii[at] * out
            length = (centers[(at + 1) % (last + 1)] - centers[at]) @ along
            found.append(start + share * length * along + shape.depth * out)
            continue
        if kind == 1:
            before, after = headings[at - 1], headings[at]
            rising, falling = math.sin(before) > 0.0, math.sin(after) < 0.0
            level = before if rising and not falling else after if falling and not rising else math.pi
            out = outward(level)
        else:
            lower, ahead = (headings[0], (1.0, 0.0)) if kind == 2 else (headings[last - 1], (-1.0, 0.0))
            out = (1.0 - share) * outward(lower) + share * np.array(ahead)
            out /= np.linalg.norm(out)
        found.append(centers[at] + (shape.radii[at] + shape.depth) * out)
    return np.array(found)


def press_bekker(reach, backing, area, deepest, stiffness, exponent, elastic):
    """Force [N] and deepest sinkage [m] of a soil behind a spring, by halving."""
    limit = stiffness * deepest**exponent
    left = deepest - limit / elastic

    def pressure(z):
        if z <= deepest:
            return max(elastic * (z - left), 0.0)
        return min(stiffness * z**exponent, limit + elastic * (z - deepest))

    if reach <= max(left, 0.0):
        return 0.0, deepest
    low, high = max(left, 0.0), reach
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if area * pressure(middle) < backing * (reach - middle) else (low, middle)
    z = 0.5 * (low + high)
    return area * pressure(z), max(z, deepest)
