"""Drivers: scripted, along paths, and the manoeuvres that they drive."""
