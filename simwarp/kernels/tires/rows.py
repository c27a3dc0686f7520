"""What a tire's row of parameters and its row of state hold, by name.

A row starts with `Common`; the entries of the model follow at `COMMON_SIZE`; a table of (deflection [m], force [N])
pairs may follow at `Common.CURVE_START`. `simwarp.vehicle.tires` fills rows; to randomise a tire, scale its entries.
SI units throughout; forces of a model are those at its reference friction.
"""

from enum import IntEnum

import warp as wp


class TireModel(IntEnum):
    """The force laws."""

    TMEASY = 0
    TMSIMPLE = 1
    FIALA = 2
    PAC89 = 3
    PAC02 = 4
    LUGRE = 5


class TireContact(IntEnum):
    """How the patch of contact is found (patch.py)."""

    SINGLE_POINT = 0
    FOUR_POINT = 1
    ENVELOPE = 2


class Common(IntEnum):
    """What every model has."""

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
    """Where the rim begins to touch [m]."""
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


COMMON_SIZE = 23


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

BRISTLE_X = wp.constant(0)
BRISTLE_Y = wp.constant(1)
BRISTLE_STATES = 2
"""Entries of the state row of every model but LuGre: deflections of the standing bristle [m]."""
