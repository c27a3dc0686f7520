"""The float64 reference of actuators on coordinates: one world, written from the words of `ActuatorSpec` alone."""

from __future__ import annotations

import math

import numpy as np

from simwarp.actuators import Activation, ActuatorSpec, Law, Target


class ReferenceActuator:
    """One actuator: its state, and what it does in a sub-step.

    Attributes:
        activation: state between control and force.
        force: of the last sub-step.
        past: controls so far, clamped.
    """

    def __init__(self, spec: ActuatorSpec, dt: float) -> None:
        self.spec, self.dt = spec, dt
        self.activation = 0.0
        self.force = 0.0
        self.past: list[float] = []

    def step(self, ctrl: float, q: np.ndarray, qd: np.ndarray) -> dict[int, float]:
        """Efforts by column, from the coordinates at the sub-step's start; of a servo the target instead."""
        spec = self.spec
        u = self._input(ctrl)
        if spec.law is Law.SERVO:
            column, coefficient = spec.terms[0]
            offset = spec.length_offset if spec.target is Target.POSITION else 0.0
            return {column: (u - offset) / coefficient}
        length = spec.length_offset + sum(c * q[i] for i, c in spec.terms)
        rate = sum(c * qd[i] for i, c in spec.terms)
        gain, bias = (np.dot(law, (1.0, length, rate)) for law in (spec.gain, spec.bias))
        force = float(np.clip(gain * u + bias, *(spec.force_range or (-math.inf, math.inf))))
        if spec.torque_speed is not None and force * rate >= 0.0:
            stall, free = spec.torque_speed
            most = stall * np.clip((free - abs(rate)) / (free - spec.corner_speed), 0.0, 1.0)
            force = float(np.clip(force, -most, most))
        self.force = force
        efforts: dict[int, float] = {}
        for column, coefficient in spec.terms:
            efforts[column] = efforts.get(column, 0.0) + coefficient * force
        return efforts

    def _input(self, ctrl: float) -> float:
        spec, h = self.spec, self.dt
        self.past.append(float(np.clip(ctrl, *spec.bounds)))
        ago = round(spec.delay / h)
        u = self.past[-1 - ago] if ago < len(self.past) else 0.0
        if not spec.has_activation:
            return u
        before = self.activation
        share = {
            Activation.INTEGRATOR: lambda: h * u,
            Activation.FILTER: lambda: (u - before) * h / spec.time_constant,
            Activation.FILTER_EXACT: lambda: (u - before) * -math.expm1(-h / spec.time_constant),
        }[spec.activation]()
        self.activation = float(np.clip(before + share, *(spec.activation_range or (-math.inf, math.inf))))
        return self.activation if spec.early else before
