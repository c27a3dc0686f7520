"""A tire's parameter vector and its state, by name.

A vector starts with `Common`; the entries of the model follow at `COMMON_SIZE`; a table of (deflection [m], force [N])
pairs may follow at `Common.CURVE_START`. `simwarp.vehicle.tires.tires` fills vectors; to randomise a tire, scale its
entries. SI units throughout; forces of a model are those at its reference friction.
"""

from enum import IntEnum

import warp as wp


class TireModel(IntEnum):
    """Force models."""

    TMEASY = 0
    TMSIMPLE = 1
    FIALA = 2
    PAC89 = 3
    PAC02 = 4
    LUGRE = 5


class TireContact(IntEnum):
    """Method that finds the contact patch (patch.py)."""

    SINGLE_POINT = 0
    FOUR_POINT = 1
    ENVELOPE = 2
    SHAPES = 3
    """The ground and the static shapes among the vehicle's `obstacles` (tire_obstacles_kernels.py)."""


class Common(IntEnum):
    """Entries at the start of every tire's parameter vector, whatever its model. SI units."""

    RADIUS = 0
    """Unloaded [m]."""
    WIDTH = 1
    RADIUS_SHARE = 2
    """Effective rolling radius = radius - share x deflection."""
    REFERENCE_FRICTION = 3
    """Friction of the road on which the model's forces were measured."""
    FRICTION_LOWER = 4
    """The road's friction is clamped to these bounds."""
    FRICTION_UPPER = 5
    CAMBER_LIMIT = 6
    """Camber beyond it counts as it [rad]."""
    LOAD_LIMIT = 7
    """Largest load with which horizontal forces grow [N]."""
    STIFFNESS = 8
    """Vertical force: stiffness d + square d² + camber term γ² d, or the table, plus bottoming [N/m]."""
    STIFFNESS_SQUARE = 9
    STIFFNESS_CAMBER = 10
    DAMPING = 11
    """Vertical [N·s/m]."""
    BOTTOM_DEFLECTION = 12
    """Deflection at which the rim begins to touch [m]."""
    BOTTOM_STIFFNESS = 13
    CURVE_START = 14
    """Index of the table in the row."""
    CURVE_POINTS = 15
    """0: no table."""
    ROLLING_RESISTANCE = 16
    """Torque per load [m] of TMeasy, TMsimple and Fiala; share of the load times the loaded radius in Pacejka 89."""
    BRISTLE_STIFFNESS = 17
    """Of the bristle that holds a standing wheel [N/m]."""
    BRISTLE_DAMPING = 18
    """[N·s/m]."""
    PATCH_MASS_X = 19
    """Mass that the patch moves along x (spin inertia / radius²) and y: keeps the bristle stable at any step [kg]."""
    PATCH_MASS_Y = 20
    BLEND_BEGIN = 21
    """Speeds between which the bristle gives way to the law of slip [m/s]."""
    BLEND_END = 22
    RELAXATION_X = 23
    """Way over which the slips of the contact follow those of the wheel [m]; 0: at once. Written later, it counts only
    for tires that were built with relaxation lengths: the others keep no slips.
    """
    RELAXATION_Y = 24


COMMON_SIZE = 25


class Tmeasy(IntEnum):
    """TMeasy: pairs of values at the nominal and at twice the nominal load."""

    NOMINAL_LOAD = COMMON_SIZE
    SLOPE_X = COMMON_SIZE + 1
    """Initial slope of the force over slip [N]."""
    MAX_X = COMMON_SIZE + 3
    """Largest force [N]."""
    SLIDE_X = COMMON_SIZE + 5
    """Force of full sliding [N]."""
    MAX_SLIP_X = COMMON_SIZE + 7
    SLIDE_SLIP_X = COMMON_SIZE + 9
    SLOPE_Y = COMMON_SIZE + 11
    MAX_Y = COMMON_SIZE + 13
    SLIDE_Y = COMMON_SIZE + 15
    MAX_SLIP_Y = COMMON_SIZE + 17
    SLIDE_SLIP_Y = COMMON_SIZE + 19
    TRAIL = COMMON_SIZE + 21
    """Pneumatic trail over the patch's length at no slip."""
    TRAIL_ZERO_SLIP = COMMON_SIZE + 23
    """Slip at which the trail changes its sign, and at which it stays zero."""
    TRAIL_END_SLIP = COMMON_SIZE + 25


TMEASY_SIZE = COMMON_SIZE + 27


class Tmsimple(IntEnum):
    """TMsimple: pairs of values as in TMeasy."""

    NOMINAL_LOAD = COMMON_SIZE
    SLOPE_X = COMMON_SIZE + 1
    MAX_X = COMMON_SIZE + 3
    SLIDE_X = COMMON_SIZE + 5
    SLOPE_Y = COMMON_SIZE + 7
    MAX_Y = COMMON_SIZE + 9
    SLIDE_Y = COMMON_SIZE + 11


TMSIMPLE_SIZE = COMMON_SIZE + 13


class Fiala(IntEnum):
    """Fiala's brush."""

    SLIP_STIFFNESS = COMMON_SIZE
    """[N per slip]."""
    CORNERING_STIFFNESS = COMMON_SIZE + 1
    """[N per tan of the slip angle]."""
    FRICTION_SLIDING = COMMON_SIZE + 2
    """At full slip, and without slip."""
    FRICTION_STATIC = COMMON_SIZE + 3


FIALA_SIZE = COMMON_SIZE + 4


class Pac89(IntEnum):
    """Pacejka 89: first entries of a0..a13 (lateral), b0..b10 (longitudinal), c0..c17 (aligning); kN, degrees, %."""

    A = COMMON_SIZE
    B = COMMON_SIZE + 14
    C = COMMON_SIZE + 25
    LATERAL_STIFFNESS = COMMON_SIZE + 43
    """Of the carcass [N/m]."""


PAC89_SIZE = COMMON_SIZE + 44

# The coefficients keep the names that they have in property files.
Pac02 = IntEnum(
    "Pac02",
    "MODE ELLIPSE ARGUMENT_LIMIT FNOMIN "
    "LFZO LCX LMUX LEX LKX LHX LVX LGAX LCY LMUY LEY LKY LHY LVY LGAY LKYG "
    "LTR LRES LGAZ LXAL LYKA LVYKA LS LMX LVMX LMY "
    "PCX1 PDX1 PDX2 PDX3 PEX1 PEX2 PEX3 PEX4 PKX1 PKX2 PKX3 PHX1 PHX2 PVX1 PVX2 RBX1 RBX2 RCX1 REX1 REX2 RHX1 "
    "QSX1 QSX2 QSX3 QSX4 QSX5 QSX7 QSX8 QSX9 QSX10 QSX11 "
    "PCY1 PDY1 PDY2 PDY3 PEY1 PEY2 PEY3 PEY4 PKY1 PKY2 PKY3 PHY1 PHY2 PHY3 PVY1 PVY2 PVY3 PVY4 "
    "RBY1 RBY2 RBY3 RCY1 REY1 REY2 RHY1 RHY2 RVY1 RVY2 RVY3 RVY4 RVY5 RVY6 "
    "QSY1 QSY2 QSY3 QSY4 QSY5 QSY6 QSY7 "
    "QBZ1 QBZ2 QBZ3 QBZ4 QBZ5 QBZ9 QBZ10 QCZ1 QDZ1 QDZ2 QDZ3 QDZ4 QDZ6 QDZ7 QDZ8 QDZ9 QEZ1 QEZ2 QEZ3 QEZ4 QEZ5 "
    "QHZ1 QHZ2 QHZ3 QHZ4 SSZ1 SSZ2 SSZ3 SSZ4 "
    "AT_PRESSURE_KX AT_PRESSURE_MUX AT_PRESSURE_KY AT_PRESSURE_PKY2 AT_PRESSURE_MUY AT_PRESSURE_TRAIL "
    "AT_PRESSURE_RESIDUAL AT_PRESSURE_MX AT_PRESSURE_MY "
    "KPUMIN KPUMAX ALPMIN ALPMAX CAMMIN CAMMAX FZMIN "
    "PTX1 PTX2 PTX3 PTY1 PTY2 LSGKP LSGAL TRANSIENT MUY_CAMBER REFERENCE_SPEED",
    start=COMMON_SIZE,
)
"""Pacejka 2002. AT_PRESSURE_*: factors of the inflation pressure. TRANSIENT 1: relaxation lengths are those of PTX1 to
PTY2. MUY_CAMBER: sign of PDY3 g². REFERENCE_SPEED: of M_y [m/s].
"""

PAC02_SIZE = COMMON_SIZE + len(Pac02)


class Lugre(IntEnum):
    """LuGre: pairs for x and y."""

    BRISTLE_STIFFNESS = COMMON_SIZE
    """sigma0 [1/m]: forces over the load."""
    BRISTLE_DAMPING = COMMON_SIZE + 2
    """sigma1 [s/m]."""
    VISCOSITY = COMMON_SIZE + 4
    """sigma2 [s/m]."""
    KINETIC_FRICTION = COMMON_SIZE + 6
    STATIC_FRICTION = COMMON_SIZE + 7
    STRIBECK_SPEED = COMMON_SIZE + 8
    """[m/s]."""
    CARRY_OFF = COMMON_SIZE + 9
    """Rate at which bristles leave a rolling patch: times |omega r| / patch length."""
    DISC_COUNT = COMMON_SIZE + 10
    DISC_SPACING = COMMON_SIZE + 11
    """Between the discs across the width [m]."""


LUGRE_SIZE = COMMON_SIZE + 12

BRISTLE_X = wp.constant(0)
BRISTLE_Y = wp.constant(1)
BRISTLE_STATES = 2
"""Entries of the state row of every model but LuGre: deflections of the standing bristle [m]. LuGre has two a disc."""
LAGGED_X = wp.constant(2)
LAGGED_STATES = 4
"""The same with relaxation: the slips of the contact follow."""
