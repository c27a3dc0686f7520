"""Kinematics of points on bodies: Jacobians, and coordinates that bring a point to a target."""

from simwarp.kinematics.inverse_kinematics import InverseKinematics
from simwarp.kinematics.jacobian import PointJacobian

__all__ = ["InverseKinematics", "PointJacobian"]
