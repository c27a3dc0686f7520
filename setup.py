"""The one thing pyproject.toml cannot say: the packages of three folders under a single top-level name."""

from setuptools import find_packages, setup

FOLDERS = {"simwarp": "simwarp", "simwarp.tasks": "tasks", "simwarp.train": "train"}


def installed_packages() -> list[str]:
    """Names of all packages as they are installed, e.g. `simwarp.kernels` and `simwarp.tasks`."""
    names = []
    for name, folder in FOLDERS.items():
        names += [name, *(f"{name}.{sub}" for sub in find_packages(folder))]
    return names


setup(packages=installed_packages())
