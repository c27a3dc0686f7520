"""What type checkers and editors see of `import simwarp as sw`; at run time the names come when they are asked for."""

from simwarp import (
    actuators as actuators,
    flex as flex,
    identify as identify,
    importers as importers,
    mcap as mcap,
    planning as planning,
    scenery as scenery,
    scenes as scenes,
    sensors as sensors,
    soil as soil,
    tasks as tasks,
    train as train,
    vehicle as vehicle,
    viewer as viewer,
)
from simwarp.api import *  # noqa: F403
from simwarp.core.interop import to_torch as to_torch

__all__: list[str]
