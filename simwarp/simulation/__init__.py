"""Simulation: state, control, contacts, steps, snapshots, diagnostics, and interfaces of elements and sensors."""
