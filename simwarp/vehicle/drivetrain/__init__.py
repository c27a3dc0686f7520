"""Drivelines, engines and transmissions."""
