"""Beams of lidar and radar, and what comes back along them."""
