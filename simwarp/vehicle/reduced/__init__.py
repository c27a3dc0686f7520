"""Reduced vehicles: a chassis on four wheels, whose suspensions are tables."""
