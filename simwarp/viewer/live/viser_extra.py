"""The extra that the live viewer needs."""

from simwarp.core.types import ModelError


def not_installed(error: ImportError) -> ModelError:
    """What to raise where one of its libraries is missing."""
    return ModelError(f"viewer: viser must be installed, got no module '{error.name}'; pip install 'simwarp[viewer]'")
