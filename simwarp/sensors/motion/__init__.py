"""Sensors of motion and forces: inertial, satellite, magnetic, encoders, force."""
