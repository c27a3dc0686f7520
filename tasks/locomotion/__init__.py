"""Walking robots. `WalkingTask` is what a task of one's own with torques at its joints begins with."""

from .walking import BASE, Orientation, Touching, WalkingConfig, WalkingTask

__all__ = ["BASE", "Orientation", "Touching", "WalkingConfig", "WalkingTask"]
