"""The magic formula (Bakker, Nyborg & Pacejka 1987) and its cosine version."""

import warp as wp

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


@wp.func
def bent(bx: float, e: float) -> float:
    """B x - E (B x - atan(B x)): slip with the curvature E."""
    return bx - e * (bx - wp.atan(bx))


@wp.func
def magic_sine(bx: float, c: float, e: float) -> float:
    """sin(C atan(B x - E (B x - atan(B x))))."""
    return wp.sin(c * wp.atan(bent(bx, e)))


@wp.func
def magic_cosine(bx: float, c: float, e: float) -> float:
    """cos(C atan(B x - E (B x - atan(B x))))."""
    return wp.cos(c * wp.atan(bent(bx, e)))
