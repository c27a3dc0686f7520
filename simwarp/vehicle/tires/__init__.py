"""Tires: their parameters by name and file, and the tires of a vehicle at work."""
