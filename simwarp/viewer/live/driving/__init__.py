"""A human at the wheel: keys and gamepads of a page, what they do to a vehicle, its dashboard, the chasing camera."""
