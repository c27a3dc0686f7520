"""Motion functions of time, with numbers per world, for prescribed motions, drives, forces and inputs."""

from __future__ import annotations

from simwarp.motions.motion_functions import (
    Constant,
    ConstantAcceleration,
    CubicSpline,
    MotionFunction,
    MotionSequence,
    Polynomial345,
    Product,
    Ramp,
    Repeat,
    Samples,
    Sine,
    Smoothness,
    Sum,
)
from simwarp.motions.motion_tape import MotionValues
from simwarp.motions.motions import BodyWrench, InputSignal, JointForce, JointMotion, Motions

__all__ = [
    "BodyWrench",
    "Constant",
    "ConstantAcceleration",
    "CubicSpline",
    "InputSignal",
    "JointForce",
    "JointMotion",
    "MotionFunction",
    "MotionSequence",
    "MotionValues",
    "Motions",
    "Polynomial345",
    "Product",
    "Ramp",
    "Repeat",
    "Samples",
    "Sine",
    "Smoothness",
    "Sum",
]
