"""Actors and critics, shipped policies, export."""
