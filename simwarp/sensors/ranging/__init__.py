"""Lidar and radar."""
