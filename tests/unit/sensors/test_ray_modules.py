"""Modules whose kernels search for hits are compiled with the options of rays."""

import importlib
import pkgutil

import pytest
import warp as wp

import simwarp.sensors
from simwarp.kernels.rays.ray_modules import RAY_MODULE_OPTIONS

SEARCHES = ("closest_hit", "any_hit")


def searching_modules() -> list[str]:
    """Modules of sensors with kernels of their own that use a search for hits."""
    names = [found.name for found in pkgutil.walk_packages(simwarp.sensors.__path__, "simwarp.sensors.")]
    found = []
    for name in names:
        if not name.endswith("_kernels"):
            continue
        module = importlib.import_module(name)
        own = [value for value in vars(module).values() if isinstance(value, wp.Kernel) and value.module.name == name]
        if own and any(search in vars(module) for search in SEARCHES):
            found.append(name)
    return found


def test_cameras_lidars_and_radars_search_for_hits() -> None:
    assert {name.rsplit(".", 1)[1] for name in searching_modules()} >= {
        "image_kernels", "lidar_kernels", "radar_kernels", "ray_casting_kernels",
    }  # fmt: skip


@pytest.mark.parametrize("name", searching_modules())
def test_the_search_is_inlined_into_its_kernels(name: str) -> None:
    options = wp.get_module_options(importlib.import_module(name))
    assert {key: options[key] for key in RAY_MODULE_OPTIONS} == RAY_MODULE_OPTIONS
