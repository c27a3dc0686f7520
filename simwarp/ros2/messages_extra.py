"""The library that serialises messages, which is optional."""

from __future__ import annotations

from simwarp.core.types import ModelError


def not_installed(error: ImportError) -> ModelError:
    """What to raise where it is missing."""
    return ModelError(f"messages of ROS 2: must have module '{error.name}', got none; pip install 'simwarp[mcap]'")
