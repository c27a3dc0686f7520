"""What tests of tasks share."""

import functools
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
import pytest

from simwarp import scenery
from simwarp.geometry import triangle_tree


@pytest.fixture(scope="session", autouse=True)
def _build_scenery_once() -> Iterator[None]:
    """Hundreds of tasks drive on the same tracks past the same meshes: the forms of both are computed once."""
    build = triangle_tree.build_tree

    @functools.cache
    def tree(vertices: bytes, triangles: bytes) -> triangle_tree.WideTree:
        return build(
            np.frombuffer(vertices, np.float32).reshape(-1, 3), np.frombuffer(triangles, np.int64).reshape(-1, 3)
        )

    def build_once(vertices: npt.ArrayLike, triangles: npt.ArrayLike) -> triangle_tree.WideTree:
        return tree(np.asarray(vertices, np.float32).tobytes(), np.asarray(triangles, np.int64).tobytes())

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(triangle_tree, "build_tree", build_once)
        for form in ("race_track", "indoor_track", "rock"):
            patch.setattr(scenery, form, functools.cache(getattr(scenery, form)))
        yield
