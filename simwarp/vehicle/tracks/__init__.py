"""Tracked vehicles, shoe by shoe or by belt: chains laid around wheels, forces of belts, drivelines, assembly."""
