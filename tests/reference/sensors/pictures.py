"""A slow ray tracer in float64 for a few spheres, boxes and planes: pixel by pixel, object by object."""

import dataclasses
import math

import numpy as np


@dataclasses.dataclass
class Thing:
    """One object: a ball of radius size[0], a box of half lengths size, or the plane z = 0 of its frame."""

    kind: str
    centre: np.ndarray
    size: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rotation: np.ndarray = dataclasses.field(default_factory=lambda: np.eye(3))
    color: tuple[float, float, float] = (0.5, 0.5, 0.5)
    label: int = 0


@dataclasses.dataclass
class Light:
    """All lights; colours are linear."""

    suns: tuple = ()  # (direction, color)
    lamps: tuple = ()  # (position, color)
    above: tuple = (0.0, 0.0, 0.0)
    below: tuple = (0.0, 0.0, 0.0)
    zenith: tuple = (0.0, 0.0, 0.0)
    horizon: tuple = (0.0, 0.0, 0.0)
    under: tuple = (0.0, 0.0, 0.0)
    density: float = 0.0
    fog: tuple = (0.0, 0.0, 0.0)
    shadows: bool = True


def meet(thing, origin, direction):
    """Distance and outward normal of the first surface of one object, or infinity."""
    o = thing.rotation.T @ (np.asarray(origin, float) - thing.centre)
    d = thing.rotation.T @ direction
    if thing.kind == "plane":
        t = -o[2] / d[2] if d[2] != 0.0 else math.inf
        return (t, thing.rotation[:, 2]) if t >= 0.0 else (math.inf, None)
    if thing.kind == "sphere":
        b, c = o @ d, o @ o - thing.size[0] ** 2
        square = b * b - c
        roots = [] if square < 0.0 else [-b - math.sqrt(square), -b + math.sqrt(square)]
        for t in roots:
            if t >= 0.0:
                return t, thing.rotation @ (o + t * d) / thing.size[0]
        return math.inf, None
    half = np.array(thing.size)
    best = (math.inf, None)
    for axis in range(3):
        for side in (-1.0, 1.0):
            if d[axis] == 0.0:
                continue
            t = (side * half[axis] - o[axis]) / d[axis]
            p = o + t * d
            others = [k for k in range(3) if k != axis]
            if 0.0 <= t < best[0] and all(abs(p[k]) <= half[k] for k in others):
                best = (t, side * thing.rotation[:, axis])
    return best


def nearest(things, origin, direction, reach):
    """(t, normal, index) of the first hit; (inf, None, -1) without one."""
    found = (math.inf, None, -1)
    for index, thing in enumerate(things):
        t, normal = meet(thing, origin, direction)
        if t <= reach and t < found[0]:
            found = (t, normal, index)
    return found


def arriving(things, point, normal, light):
    """Light that a white matt surface sends back."""
    up = 0.5 + 0.5 * normal[2]
    total = up * np.array(light.above) + (1.0 - up) * np.array(light.below)
    start = point + 1e-6 * normal
    for direction, color in light.suns:
        towards = np.array(direction) / np.linalg.norm(direction)
        hidden = light.shadows and nearest(things, start, towards, math.inf)[2] >= 0
        total = total + (not hidden) * max(float(normal @ towards), 0.0) * np.array(color)
    for position, color in light.lamps:
        way = np.array(position) - point
        distance = float(np.linalg.norm(way))
        hidden = light.shadows and nearest(things, start, way / distance, distance)[2] >= 0
        total = total + (not hidden) * max(float(normal @ way) / distance, 0.0) / distance**2 * np.array(color)
    return total


def along(things, origin, direction, light, reach):
    """Linear light along a ray, and its hit."""
    t, normal, index = nearest(things, origin, direction, reach)
    if index < 0:
        share = math.sqrt(max(direction[2], 0.0))
        seen = (1.0 - share) * np.array(light.horizon) + share * np.array(light.zenith)
        seen = seen if direction[2] > 0.0 else np.array(light.under)
    else:
        normal = normal if normal @ direction < 0.0 else -normal
        point = np.asarray(origin, float) + t * direction
        seen = np.array(things[index].color) * arriving(things, point, normal, light)
    clear = math.exp(-light.density * min(t, reach))
    return clear * seen + (1.0 - clear) * np.array(light.fog), t, normal, index


def take(things, eye, rotation, rays, light, reach):
    """Pictures of (height, width, 3) rays in camera axes: linear light, range, depth, normals (camera axes), index."""
    height, width = rays.shape[:2]
    out = {name: np.zeros((height, width, n)) for name, n in (("light", 3), ("range", 1), ("depth", 1), ("normals", 3))}
    out["instance"] = np.full((height, width, 1), -1)
    for row in range(height):
        for column in range(width):
            ahead = rays[row, column]
            seen, t, normal, index = along(things, eye, rotation @ ahead, light, reach)
            out["light"][row, column] = seen
            out["range"][row, column] = min(t, reach)
            out["depth"][row, column] = t * ahead[0] if index >= 0 else reach
            out["normals"][row, column] = rotation.T @ normal if index >= 0 else 0.0
            out["instance"][row, column] = index
    return out


def processed(light, gamma=2.2, exposure=1.0, vignetting=0.0, cosine=1.0):
    """Values 0 to 255, not rounded."""
    gain = exposure * (1.0 - vignetting + vignetting * cosine**4)
    return 255.0 * np.clip(np.clip(gain * light, 0.0, 1.0) ** (1.0 / gamma), 0.0, 1.0)
