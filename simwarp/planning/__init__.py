"""Planning without a policy: what to do next is found by trying it in worlds that are copies of the real one."""

from simwarp.planning.action_splines import ActionSpline, Spline
from simwarp.planning.cross_entropy import CrossEntropy, CrossEntropyConfig
from simwarp.planning.imagination import Imagination
from simwarp.planning.iterative_lqr import Ilqr, IlqrConfig
from simwarp.planning.path_integral import Mppi, MppiConfig

__all__ = [
    "ActionSpline", "CrossEntropy", "CrossEntropyConfig", "Ilqr", "IlqrConfig", "Imagination", "Mppi", "MppiConfig",
    "Spline",
]  # fmt: skip
