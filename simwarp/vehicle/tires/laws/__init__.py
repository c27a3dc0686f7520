"""Force laws of tires, on the device."""
