"""What a node of the soil does to the surface above it, per area, and what it remembers of a step."""

import warp as wp

from simwarp.soil.bekker_janosi_kernels import Law, press
from simwarp.soil.soil_tables_kernels import LEAN_X, LEAN_Y, SHEAR, SINKAGE, YIELD, SoilNodes, SoilTables

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

STILL = wp.constant(1.0e-9)
"""Way within a step below which shear has no direction [m]."""


@wp.func
def lean_of(slot: int, world: int, n: wp.vec3, nodes: SoilNodes) -> wp.vec3:
    """Direction of a node's shear, in the plane across n."""
    lean = wp.vec3(nodes.node[world, slot, LEAN_X], nodes.node[world, slot, LEAN_Y], 0.0)
    lean[2] = -(n[0] * lean[0] + n[1] * lean[1]) / n[2]
    return lean


@wp.func
def remember_shear(
    slot: int, world: int, dt: float, slide: wp.vec3, n: wp.vec3, soil: SoilTables, nodes: SoilNodes
):  # fmt: skip
    """Moves the way that a node was sheared on, and its direction towards that of the slip."""
    speed = wp.length(slide)
    nodes.node[world, slot, SHEAR] = nodes.node[world, slot, SHEAR] + speed * dt
    if soil.scalar_shear == 0 and speed > 0.0:
        ahead = slide / speed
        lean = ahead + wp.exp(-speed * dt / soil.length) * (lean_of(slot, world, n, nodes) - ahead)
        nodes.node[world, slot, LEAN_X] = lean[0]
        nodes.node[world, slot, LEAN_Y] = lean[1]


@wp.struct
class NodeStress:
    """Stresses on a surface, and how they change with its velocity."""

    bears: int  # 0: there are none
    pressure: float  # along its normal [Pa]
    against: wp.vec3  # shear, in the direction of the slip [Pa]
    stiffness: float  # of the pressure per sinkage [Pa/m]
    damping: float  # of the pressure [Pa s/m]
    drag: float  # of the shear per velocity, times the step [Pa s^2/m]
    sunk: float  # what the node yielded by, along the normal of the ground [m]


@wp.func
def node_stress(
    slot: int, world: int, dt: float, sinkage: float, after: float, v: wp.vec3, n: wp.vec3, law: Law, soil: SoilTables,
    nodes: SoilNodes,
) -> NodeStress:  # fmt: skip
    """Moves the memory of a node on, and returns its stresses.

    Args:
        sinkage: of the surface now, along the normal of the ground [m].
        after: the same at the end of the step, at the present velocity.
        v: of the surface at the node [m/s].
        n: unit normal along which pressure acts: of the ground or, against it, of the surface.
    """
    s = NodeStress()
    plastic = nodes.node[world, slot, SINKAGE]
    before = press(sinkage, plastic, nodes.node[world, slot, YIELD], law)
    s.sunk = before.plastic - plastic
    nodes.node[world, slot, SINKAGE] = before.plastic
    nodes.node[world, slot, YIELD] = before.limit
    touched = before.pressure > 0.0
    rising = wp.dot(v, n)
    slide = v - rising * n
    if touched:
        remember_shear(slot, world, dt, slide, n, soil, nodes)
    pressed = press(after, before.plastic, before.limit, law)
    if pressed.pressure <= 0.0:
        return s
    s.bears = 1
    s.damping = wp.where(touched, law.damping, 0.0)  # of a node reached within the step it comes with the next one
    s.pressure = pressed.pressure - s.damping * rising
    if s.pressure < 0.0:  # soil does not pull
        s.pressure = 0.0
        s.damping = 0.0
    way = after - sinkage
    s.stiffness = law.elastic
    if wp.abs(way) >= 1.0e-7:
        s.stiffness = wp.clamp((pressed.pressure - before.pressure) / way, 0.0, law.elastic)
    speed = wp.length(slide)
    sheared = nodes.node[world, slot, SHEAR]
    most = (law.cohesion + s.pressure * law.tan_phi) * (1.0 - wp.exp(-sheared / law.shear_length))
    if soil.scalar_shear == 1:
        s.drag = dt * most / wp.max(speed, STILL / dt)
        s.against = slide * (s.drag / dt)
    else:
        turned = speed * dt / soil.length
        taken = dt / soil.length  # (1 - e^-q) / (q l) h, its limit at rest
        if turned > 1.0e-4:
            taken = (1.0 - wp.exp(-turned)) / speed
        held = soil.rest_time * wp.exp(-speed / soil.rest_speed) / soil.length
        against = lean_of(slot, world, n, nodes) + held * slide
        s.against = most * against / wp.max(1.0, wp.length(against))
        s.drag = dt * most * (taken + held)
    return s
