"""Tracked vehicles, shoe by shoe: chains laid around their wheels, files, assembly into a model."""
