"""Engineering analysis of a simulation: statics, assembly, linear models, modes of vibration."""

from simwarp.analysis.linearisation import Linearisation, linearise
from simwarp.analysis.loop_closing import Assembly, JointGap, assemble
from simwarp.analysis.modes import Modes, modes
from simwarp.analysis.statics import StaticResult, solve_static

__all__ = [
    "Assembly", "JointGap", "Linearisation", "Modes", "StaticResult", "assemble", "linearise", "modes", "solve_static",
]  # fmt: skip
