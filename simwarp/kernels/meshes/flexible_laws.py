"""What all flexible elements read: the numbers of a step, and the materials of parts, in a world."""

import warp as wp

from simwarp.kernels.core.tables import world_row

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

ELASTIC = wp.constant(0)  # stress proportional to strain
RUBBER = wp.constant(1)  # stable neo-Hookean


@wp.struct
class FlexibleStep:
    """Numbers of a linearly implicit step, (M + h d + h² (β + ζ) K) Δv = h (f(x) - (d + ζ h K) v)."""

    h: float  # [s]
    numerical_damping: float  # ζ
    gravity: wp.vec3  # [m/s²]


@wp.func
def stiffness_gain(step: FlexibleStep) -> float:
    """h² (β + ζ) with β = (1 - ζ)² / 4: a margin of ζ² of the stiffness for what the matrix lacks [s²]."""
    share = 0.5 * (1.0 + step.numerical_damping)
    return step.h * step.h * share * share


@wp.struct
class FlexibleMaterials:
    """Materials by part. Arrays of two axes have leading dimension 1 (shared) or W."""

    kind: wp.array[int]  # ELASTIC or RUBBER
    poisson: wp.array[float]
    young: wp.array2d[float]  # [Pa]
    damping_time: wp.array2d[float]  # [s]


@wp.struct
class Law:
    """A material in a world, in a step."""

    kind: int
    shear: wp.float64  # µ [Pa]
    lame: wp.float64  # λ [Pa]
    young: float  # [Pa]
    rate: wp.float64  # stress per strain rate over stress per strain, the numerical part included [s]
    material_gain: (
        float  # of the matrix's part that strains cause: h times the material's damping and `geometric_gain` [s²]
    )
    geometric_gain: float  # of the part that stress causes [s²]


@wp.func
def law_of(world: int, part: int, materials: FlexibleMaterials, step: FlexibleStep) -> Law:
    """The material of a part."""
    law = Law()
    law.kind = materials.kind[part]
    law.young = materials.young[world_row(world, materials.young.shape[0]), part]
    poisson = wp.float64(materials.poisson[part])
    one, two = wp.float64(1.0), wp.float64(2.0)
    law.shear = wp.float64(law.young) / (two * (one + poisson))
    law.lame = two * law.shear * poisson / (one - two * poisson)
    time = materials.damping_time[world_row(world, materials.damping_time.shape[0]), part]
    law.rate = wp.float64(time) + wp.float64(step.numerical_damping) * wp.float64(step.h)
    law.geometric_gain = stiffness_gain(step)
    law.material_gain = law.geometric_gain + step.h * time
    return law
