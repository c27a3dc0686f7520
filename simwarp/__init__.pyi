"""What type checkers and editors see of `import simwarp as sw`; at run time the names come when they are asked for."""

from simwarp import actuators as actuators
from simwarp import importers as importers
from simwarp import scenery as scenery
from simwarp import scenes as scenes
from simwarp import sensors as sensors
from simwarp import soil as soil
from simwarp import tasks as tasks
from simwarp import train as train
from simwarp import vehicle as vehicle
from simwarp import viewer as viewer
from simwarp.api import *  # noqa: F403
from simwarp.core.interop import to_torch as to_torch

__all__: list[str]
