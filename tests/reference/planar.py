"""Independent references of high accuracy: pendulum, double pendulum, free body, slider-crank, four-bar."""

from __future__ import annotations

import numpy as np
from scipy.integrate import quad, solve_ivp
from scipy.special import ellipk

from simwarp.scenes import FourBar, four_bar_angles

G = 9.81


def pendulum_period(length: float = 1.0, amplitude: float = 0.5 * np.pi, gravity: float = G) -> float:
    """Period [s] of a point mass on a massless arm, by the complete elliptic integral."""
    return float(4.0 * np.sqrt(length / gravity) * ellipk(np.sin(0.5 * amplitude) ** 2))


def pendulum_period_quadrature(length: float = 1.0, amplitude: float = 0.5 * np.pi, gravity: float = G) -> float:
    """The same by quadrature of the energy integral, sin(theta/2) = sin(amplitude/2) sin(s)."""
    k = np.sin(0.5 * amplitude)
    value, _ = quad(lambda s: 1.0 / np.sqrt(1.0 - (k * np.sin(s)) ** 2), 0.0, 0.5 * np.pi, epsabs=1e-13)
    return float(4.0 * np.sqrt(length / gravity) * value)


def double_pendulum_rate(state: np.ndarray, mass: float = 1.0, length: float = 1.0) -> np.ndarray:
    """Rates of (theta1, theta2, w1, w2) of two uniform rods, angles below +X, inertia m l²/12 each."""
    a, b, w1, w2 = state
    inertia = mass * length**2 / 12.0
    cross = 0.5 * mass * length**2 * np.cos(a - b)
    matrix = np.array([[inertia + 1.25 * mass * length**2, cross], [cross, inertia + 0.25 * mass * length**2]])
    s = 0.5 * mass * length**2 * np.sin(a - b)
    force = np.array([1.5 * mass * G * length * np.cos(a) - s * w2**2, 0.5 * mass * G * length * np.cos(b) + s * w1**2])
    return np.concatenate([[w1, w2], np.linalg.solve(matrix, force)])


def double_pendulum_rk4(duration: float, h: float = 1e-3) -> np.ndarray:
    """(theta1, theta2, w1, w2) after `duration` from rest along +X, by classical RK4."""
    state = np.zeros(4)
    for _ in range(round(duration / h)):
        k1 = double_pendulum_rate(state)
        k2 = double_pendulum_rate(state + 0.5 * h * k1)
        k3 = double_pendulum_rate(state + 0.5 * h * k2)
        k4 = double_pendulum_rate(state + h * k3)
        state = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return state


def free_body(inertia: np.ndarray, omega: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Orientation (T, 4) xyzw and world omega (T, 3) of a free rigid body starting at the identity."""
    inertia = np.asarray(inertia, float)
    matrix = np.diag(inertia) if inertia.ndim == 1 else inertia

    def rate(_: float, y: np.ndarray) -> np.ndarray:
        q, w = y[:4], y[4:]
        qv = 0.5 * (q[3] * w + np.cross(q[:3], w))
        return np.concatenate([qv, [-0.5 * q[:3] @ w], np.linalg.solve(matrix, -np.cross(w, matrix @ w))])

    start = np.concatenate([[0.0, 0.0, 0.0, 1.0], omega])
    y = solve_ivp(rate, (0.0, float(times[-1])), start, "DOP853", times, rtol=1e-12, atol=1e-13).y.T
    q, w = y[:, :4] / np.linalg.norm(y[:, :4], axis=1, keepdims=True), y[:, 4:]
    t = 2.0 * np.cross(q[:, :3], w)
    return q, w + q[:, 3:] * t + np.cross(q[:, :3], t)


def flip_times(inertia: tuple[float, ...], omega: tuple[float, ...], duration: float) -> np.ndarray:
    """Times at which the middle body rate crosses zero, for a diagonal inertia."""
    i = np.asarray(inertia, float)

    def rate(_: float, w: np.ndarray) -> np.ndarray:
        return -np.cross(w, i * w) / i

    def crossing(_: float, w: np.ndarray) -> float:
        return float(w[1])

    return solve_ivp(rate, (0.0, duration), omega, "RK45", events=crossing, rtol=1e-11, atol=1e-13).t_events[0]


def slider_position(angle: np.ndarray | float, crank: float = 0.5, rod: float = 1.5) -> np.ndarray:
    """x of the slider [m]: r cos(angle) + sqrt(l² - (r sin(angle))²)."""
    return crank * np.cos(angle) + np.sqrt(rod**2 - (crank * np.sin(angle)) ** 2)


def four_bar_energy(sizes: FourBar, angle: float, speed: float) -> tuple[float, float]:
    """(kinetic, potential) energy [J] of the rods of `scenes.four_bar` at a crank angle and speed."""
    (coupler, rocker), (wc, wr) = four_bar_angles(sizes, angle, speed)
    links = (
        (sizes.crank, sizes.crank_mass, angle, speed, 0.0, np.zeros(2)),
        (sizes.coupler, sizes.coupler_mass, coupler, wc, sizes.crank * np.sin(angle), _end_speed(sizes, angle, speed)),
        (sizes.rocker, sizes.rocker_mass, rocker, wr, 0.0, np.zeros(2)),
    )
    kinetic = potential = 0.0
    for length, mass, turn, rate, height, start in links:
        inertia = mass * length**2 * (1.0 / 12.0 + 0.25 / 2500.0)
        v = start + 0.5 * length * rate * np.array([-np.sin(turn), np.cos(turn)])
        kinetic += 0.5 * mass * float(v @ v) + 0.5 * inertia * rate**2
        potential += mass * G * (height + 0.5 * length * np.sin(turn))
    return kinetic, potential


def _end_speed(sizes: FourBar, angle: float, speed: float) -> np.ndarray:
    return sizes.crank * speed * np.array([-np.sin(angle), np.cos(angle)])


def four_bar_crank(sizes: FourBar, angle: float, speed: float, times: np.ndarray) -> np.ndarray:
    """Crank angle [rad] over time by conservation of energy (the crank must not come to rest)."""
    total = sum(four_bar_energy(sizes, angle, speed))

    def rate(_: float, y: np.ndarray) -> list[float]:
        unit, potential = four_bar_energy(sizes, y[0], 1.0)
        return [np.sign(speed) * np.sqrt((total - potential) / unit)]

    return solve_ivp(rate, (0.0, float(times[-1])), [angle], "DOP853", times, rtol=1e-11, atol=1e-12).y[0]
