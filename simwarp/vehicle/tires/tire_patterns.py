"""Tires known by little more than their size: load indices, and characteristic values of typical tires.

The values are those with which Project Chrono (BSD-3) guesses TMeasy and TMsimple tires: forces over the load at the
nominal and at twice the nominal load, measured on typical truck (aspect ratio 80 %) and passenger car (70 %) tires.
"""

from __future__ import annotations

import math

from simwarp.vehicle.spec.vehicle_spec import SpecError, refuse

GRAVITY = 9.81

# Of load indices 0, 1, ...: the mass that a tire bears [kg]; from ten to ten.
BEARABLE_MASS = (
    45, 46.5, 47.5, 48.7, 50, 51.5, 53, 54.5, 56, 58,
    60, 61.5, 63, 65, 67, 69, 71, 73, 75, 77.5,
    80, 82.5, 85, 87.5, 90, 92.5, 95, 97.5, 100, 103,
    106, 109, 112, 115, 118, 121, 125, 128, 132, 136,
    140, 145, 150, 155, 160, 165, 170, 175, 180, 185,
    190, 195, 200, 206, 212, 218, 224, 230, 236, 243,
    250, 257, 265, 272, 280, 290, 300, 307, 315, 325,
    335, 345, 355, 365, 375, 387, 400, 412, 425, 437,
    450, 462, 475, 487, 500, 515, 530, 545, 560, 580,
    600, 615, 630, 650, 670, 690, 710, 730, 750, 775,
    800, 825, 850, 875, 900, 925, 950, 975, 1000, 1030,
    1060, 1090, 1120, 1150, 1180, 1215, 1250, 1285, 1320, 1360,
    1400, 1450, 1500, 1550, 1600, 1650, 1700, 1750, 1800, 1850,
    1900, 1950, 2000, 2060, 2120, 2180, 2240, 2300, 2360, 2430,
    2500, 2575, 2650, 2725, 2800, 2900, 3000, 3075, 3150, 3250,
    3350, 3450, 3550, 3650, 3750, 3875, 4000, 4125, 4250, 4375,
    4500, 4625, 4750, 4875, 5000, 5150, 5300, 5450, 5600, 5850,
    6000, 6150, 6300, 6500, 6700, 6900, 7100, 7300, 7500, 7750,
    8000, 8250, 8500, 8750, 9000, 9250, 9500, 9750, 10000, 10300,
    10600, 10900, 11200, 11500, 11800, 12150, 12500, 12850, 13200, 13600,
    14000, 14500, 15000, 15550, 16000, 16500, 17000, 17500, 18000, 18500,
    19000, 19500, 20000, 20600, 21200, 21800, 22400, 23000, 23600, 24300,
    25000, 25750, 26500, 27250, 28000, 29000, 30000, 30750, 31500, 32500,
    33500, 34500, 35500, 36500, 37500, 38750, 40000, 41250, 42500, 43750,
    45000, 46250, 47500, 48750, 50000, 51500, 53000, 54500, 56000, 58000,
    60000, 61500, 63000, 65000, 67000, 69000, 71000, 73000, 75000, 77500,
    80000, 82500, 85000, 87500, 90000, 92500, 95000, 97500, 100000, 103000,
    106000, 109000, 112000, 115000, 118000, 121000, 125000, 128500, 132000, 136000,
)  # fmt: skip

FORCES = ("slope_x", "max_x", "slide_x", "slope_y", "max_y", "slide_y")
"""Given over the load; the other values have no unit."""

TMEASY_PATTERNS: dict[str, dict[str, tuple[float, float]]] = {
    "truck": {
        "slope_x": (17.7764, 14.5301), "max_x": (0.89965, 0.77751), "slide_x": (0.46183, 0.42349),
        "max_slip_x": (0.10811, 0.12389), "slide_slip_x": (0.66667, 0.66667),
        "slope_y": (7.4013, 6.8505), "max_y": (0.75876, 0.72628), "slide_y": (0.68276, 0.65319),
        "max_slip_y": (0.33167, 0.33216), "slide_slip_y": (1.0296, 1.0296),
        "trail": (0.178, 0.19), "trail_zero_slip": (0.36484, 0.36538), "trail_end_slip": (1.0296, 1.0296),
    },
    "car": {
        "slope_x": (18.3741, 19.4669), "max_x": (1.1292, 1.0896), "slide_x": (0.80149, 0.76917),
        "max_slip_x": (0.13913, 0.13913), "slide_slip_x": (0.66667, 0.66667),
        "slope_y": (15.9826, 12.8509), "max_y": (1.0009, 0.91367), "slide_y": (0.8336, 0.77336),
        "max_slip_y": (0.14852, 0.18504), "slide_slip_y": (0.96524, 1.0714),
        "trail": (0.178, 0.19), "trail_zero_slip": (0.16337, 0.20355), "trail_end_slip": (0.96524, 1.0714),
    },
}  # fmt: skip

TMSIMPLE_PATTERNS: dict[str, dict[str, tuple[float, float]]] = {
    "truck": {
        "slope_x": (19.1677, 15.1285), "max_x": (0.91432, 0.79538), "slide_x": (0.52273, 0.48517),
        "slope_y": (6.8392, 6.4235), "max_y": (0.75948, 0.72714), "slide_y": (0.68739, 0.65594),
    },
    "car": {
        "slope_x": (19.9774, 20.8424), "max_x": (1.1404, 1.1045), "slide_x": (0.84482, 0.82041),
        "slope_y": (16.7895, 12.9866), "max_y": (1.0107, 0.91902), "slide_y": (0.84864, 0.78702),
    },
}  # fmt: skip


def bearable_load(index: int) -> float:
    """The load of a load index [N]."""
    if not 0 <= index < len(BEARABLE_MASS):
        raise refuse("load_index", f"from 0 to {len(BEARABLE_MASS) - 1}", index)
    return GRAVITY * BEARABLE_MASS[index]


def rated_load(load: float | None, index: int | None) -> float:
    """The load that a tire is made for [N]; an index counts before a force."""
    if index is not None:
        return bearable_load(index)
    if load is None:
        raise SpecError("load: missing; give the largest load [N], or load_index")
    return load


def vertical_guess(
    load: float, section_height: float, mass: float, pressure_ratio: float, damping_ratio: float
) -> dict[str, float]:
    """Vertical law of a tire that bears `load` [N] at 16 % of its section height; its nominal load is half of that."""
    stiffness = load / (0.16 * section_height)
    nominal = 0.5 * load * pressure_ratio**0.8
    return {
        "nominal_load": nominal,
        "load_limit": 3.5 * nominal,
        "vertical_stiffness": stiffness,
        "vertical_damping": 2.0 * damping_ratio * math.sqrt(stiffness * mass),
    }


def horizontal_guess(pattern: dict[str, tuple[float, float]], nominal: float) -> dict[str, tuple[float, float]]:
    """A pattern with its forces in N."""
    return {
        key: (a * nominal, b * 2.0 * nominal) if key in FORCES else (a, b) for key, (a, b) in pattern.items()
    }  # fmt: skip
