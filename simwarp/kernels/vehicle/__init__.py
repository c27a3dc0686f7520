"""What drives a vehicle: inputs, powertrain, drivers along paths."""
