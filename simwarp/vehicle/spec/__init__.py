"""Descriptions of vehicles: typed, validated, from files and by name."""
