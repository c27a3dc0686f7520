"""Wheeled vehicles: descriptions, assembly into a model, tires, powertrain, drivers."""
