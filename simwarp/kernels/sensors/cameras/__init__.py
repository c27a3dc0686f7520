"""Images: lenses, surfaces, light, and what the chip makes of it."""
