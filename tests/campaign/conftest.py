"""One set of good files, and one sandbox, for all fronts."""

import pytest

from tests.campaign import strategies_builder
from tests.campaign.fronts import Place
from tests.campaign.material import command, make_material
from tests.campaign.sandbox import Sandbox


@pytest.fixture(scope="session")
def place(tmp_path_factory):
    """Good files, bystanders, and kernels that are loaded: compiling them takes longer than any alarm waits."""
    material = make_material(tmp_path_factory.mktemp("material"))
    sandbox = Sandbox(tmp_path_factory.mktemp("sandbox"), material)
    with sandbox.inside():
        command("bench", "pendulum", "--worlds=1", "--seconds=0.01")
    strategies_builder.warm_up()
    sandbox.restore()
    return Place(material, sandbox, tmp_path_factory.mktemp("files"))
