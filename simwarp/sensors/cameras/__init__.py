"""Cameras: lenses, lights, surfaces, image processing."""
