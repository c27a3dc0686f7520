"""A wheel that stands or rolls steadily on flat virgin soil: integrals over its contact, float64, no nodes, no steps.

x runs forward from the wheel's middle. A column of soil at x has the sinkage z(x) = z_0 - r + sqrt(r^2 - x^2), and the
rim there, d(x) = sqrt(r^2 - x^2) below the axle, slides forward at v - omega d(x). Pressure is vertical, shear stress
horizontal: the front's resistance is in the torque alone, and the pull is the integral of the shear stress.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from tests.reference.soil import SCALAR, ShearMemory, SoilParameters, rectangle_inverse_b
from tests.reference.soil_shapes import Array, Wheel

POINTS = 4001
"""Nodes of the trapezoidal rule, for the front and for the rear."""


class Rolling(NamedTuple):
    """A wheel at a slip under a load; pull and torque over W and W r."""

    sinkage: float
    rut: float
    """Sinkage left behind it."""
    pull: float
    torque: float


@dataclasses.dataclass
class Contact:
    """Columns under a wheel from the front to the rear: x, sinkage, pressure and depth below the axle."""

    x: Array
    z: Array
    sigma: Array
    d: Array
    plastic: float

    def integral(self, f: Array) -> float:
        """Over x; the columns run backwards."""
        return -float(np.trapezoid(f, self.x))


def bisect(f: Callable[[float], float], low: float, high: float) -> float:
    """Root of a rising function."""
    if not f(low) < 0.0 < f(high):
        raise ValueError(f"no root between {low} and {high}")
    for _ in range(100):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if f(middle) < 0.0 else (low, middle)
    return 0.5 * (low + high)


def half_chord(radius: float, depth: float) -> float:
    """Half the length of a disc's contact at a depth."""
    return float(np.sqrt(radius**2 - (radius - depth) ** 2))


def cosine_nodes(start: float, end: float) -> Array:
    """From start to end, dense at both ends, where pressure has a kink or an infinite slope."""
    return start + (end - start) * 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, POINTS)))


def standing_contact(wheel: Wheel, soil: SoilParameters, z0: float) -> Contact:
    """Pressed into virgin soil straight from above: the curve everywhere."""
    a = half_chord(wheel.radius, z0)
    x = cosine_nodes(a, -a)
    d = np.sqrt(wheel.radius**2 - x * x)
    z = np.maximum(z0 - wheel.radius + d, 0.0)
    return Contact(x, z, soil.curve(z, rectangle_inverse_b(2.0 * a, wheel.width)), d, 0.0)


def rolling_contact(wheel: Wheel, soil: SoilParameters, z0: float, omega: float = 0.0) -> Contact:
    """Ahead of the lowest line virgin soil yields, behind it unloads along K_el; R counts at a spin omega [rad/s]."""
    r = wheel.radius
    front = half_chord(r, z0)
    inverse_b, plastic = 0.0, 0.0
    rear = 0.0
    for _ in range(50):  # the patch's length depends on b a little, through the elastic rear
        inverse_b = rectangle_inverse_b(front + rear, wheel.width)
        bottom = float(soil.curve(z0, inverse_b))
        plastic = z0 - bottom / soil.elastic
        rear = half_chord(r, z0 - plastic)
    x = np.concatenate([cosine_nodes(front, 0.0), cosine_nodes(0.0, -rear)[1:]])
    d = np.sqrt(r * r - x * x)
    z = np.maximum(z0 - r + d, 0.0)
    static = np.where(x >= 0.0, soil.curve(z, inverse_b), soil.elastic * np.maximum(z - plastic, 0.0))
    sigma = np.where(static > 0.0, np.maximum(static + soil.damping * omega * x, 0.0), 0.0)
    return Contact(x, z, sigma, d, plastic)


def load_of(wheel: Wheel, contact: Contact) -> float:
    return wheel.width * contact.integral(contact.sigma)


def standing_sinkage(wheel: Wheel, soil: SoilParameters, load: float) -> float:
    """Sinkage at which a wheel pressed in slowly bears a load."""
    return bisect(lambda z: load_of(wheel, standing_contact(wheel, soil, z)) - load, 1e-6, 0.999 * wheel.radius)


def rolling_sinkage(wheel: Wheel, soil: SoilParameters, load: float, omega: float = 0.0) -> float:
    """Sinkage of steady rolling; pressure is vertical, so that it does not depend on slip."""
    return bisect(lambda z: load_of(wheel, rolling_contact(wheel, soil, z, omega)) - load, 1e-6, 0.999 * wheel.radius)


def shear_stress(contact: Contact, soil: SoilParameters, ratio: float, memory: ShearMemory, speed: float) -> Array:
    """Horizontal stress on the rim, forward > 0.

    A column meets the rim first in front, then slides by |v - omega d| dx / v per length of travel: J and the
    direction begin at zero at the front edge. `ratio` is omega / v; `speed`, v, only counts for the direction's
    damping, infinite speed leaves it out.
    """
    slide = 1.0 - ratio * contact.d
    steps = -np.diff(contact.x) * 0.5 * (np.abs(slide[1:]) + np.abs(slide[:-1]))
    shear = np.concatenate([[0.0], np.cumsum(steps)])
    limit = (soil.cohesion + contact.sigma * soil.friction) * -np.expm1(-shear / soil.shear_modulus)
    if memory.kind == "scalar":
        return -limit * np.sign(slide)
    direction = np.zeros(len(slide))
    ahead = np.sign(slide[1:] + slide[:-1])
    for i, step in enumerate(steps):
        direction[i + 1] = ahead[i] + (direction[i] - ahead[i]) * np.exp(-step / memory.length)
    if np.isfinite(speed):
        v_t = speed * slide
        damping = memory.time * np.exp(-np.abs(v_t) / memory.speed) / memory.length
        direction = np.clip(direction + damping * v_t, -1.0, 1.0)
    return -limit * direction


def rolling(
    wheel: Wheel,
    soil: SoilParameters,
    load: float,
    slip: float,
    memory: ShearMemory = SCALAR,
    speed: float = np.inf,
) -> Rolling:
    """Steady rolling at the slip 1 - v / (omega r). With a finite speed v, R and the direction's damping count."""
    ratio = 1.0 / (wheel.radius * (1.0 - slip))
    omega = speed * ratio if np.isfinite(speed) else 0.0
    z0 = rolling_sinkage(wheel, soil, load, omega)
    contact = rolling_contact(wheel, soil, z0, omega)
    tau = shear_stress(contact, soil, ratio, memory, speed)
    pull = wheel.width * contact.integral(tau)
    torque = wheel.width * contact.integral(tau * contact.d + contact.sigma * contact.x)
    return Rolling(z0, contact.plastic, pull / load, torque / (load * wheel.radius))


def rolling_along_surface(wheel: Wheel, soil: SoilParameters, load: float, slip: float) -> Rolling:
    """Steady rolling at a slip with pressure along the rim's normal and shear along the rim (Wong and Reece 1967);
    scalar memory, no damping. An element of the rim of length dx / cos a, with sin a = x / r, carries both.
    """
    r, ratio = wheel.radius, 1.0 / (wheel.radius * (1.0 - slip))

    def stresses(z0: float) -> tuple[Contact, Array]:
        contact = rolling_contact(wheel, soil, z0)
        cosine = contact.d / r
        # the rim slides along itself by v cos a - omega r, over the time dx / v
        slide = cosine - ratio * r
        steps = -np.diff(contact.x) * 0.5 * (np.abs(slide[1:]) + np.abs(slide[:-1]))
        shear = np.concatenate([[0.0], np.cumsum(steps)])
        limit = (soil.cohesion + contact.sigma * soil.friction) * -np.expm1(-shear / soil.shear_modulus)
        return contact, -limit * np.sign(slide)

    def excess(z0: float) -> float:
        contact, tau = stresses(z0)
        return wheel.width * contact.integral(contact.sigma + tau * contact.x / contact.d) - load

    z0 = bisect(excess, 1e-6, 0.9 * r)
    contact, tau = stresses(z0)
    pull = wheel.width * contact.integral(tau - contact.sigma * contact.x / contact.d)
    torque = wheel.width * contact.integral(tau * r * r / contact.d)
    return Rolling(z0, contact.plastic, pull / load, torque / (load * r))
