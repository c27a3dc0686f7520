"""Tires from descriptions: guesses, checks, property files."""

import json

import numpy as np
import pytest

from simwarp.vehicle.spec.vehicle_files import read_spec
from simwarp.vehicle.spec.vehicle_spec import SpecError, Tire
from simwarp.vehicle.tires.parameter_vector import BEARABLE_MASS
from simwarp.vehicle.tires.parameter_vector_kernels import (
    Common,
    Fiala,
    Lugre,
    Pac02,
    Pac89,
    TireContact,
    TireModel,
    Tmeasy,
    Tmsimple,
)
from simwarp.vehicle.tires.tire_properties import ASYMMETRIC
from simwarp.vehicle.tires.tires import tire_vector
from tests.unit.vehicle.tires.tire_bench import DATA, TEMPLATES, properties, row_of, run, steady


def bare(template, **parameters):
    """A tire of the HMMWV's size with these parameters only."""
    return Tire(
        template=template, mass=37.6, inertia=(3.84, 6.69, 3.84), radius=0.4699, width=0.3175, parameters=parameters
    )  # fmt: skip


def test_truck_guess_of_the_hmmwv():
    """3850 lbf on a section of 10.25 in: 17125.65 N at 0.16 · 0.26035 m."""
    row = row_of("tmeasy").values
    load = 3850 * 4.4482216153
    stiffness = load / 0.041656
    assert row[Common.STIFFNESS] == pytest.approx(stiffness, rel=1e-6)
    assert row[Common.DAMPING] == pytest.approx(np.sqrt(stiffness * 37.6), rel=1e-6)
    assert row[Tmeasy.NOMINAL_LOAD] == pytest.approx(0.5 * load, rel=1e-6)
    assert row[Common.LOAD_LIMIT] == pytest.approx(1.75 * load, rel=1e-6)
    assert row[Common.BOTTOM_DEFLECTION] == pytest.approx(0.25035, rel=1e-6)
    assert row[Common.BOTTOM_STIFFNESS] == pytest.approx(5 * stiffness, rel=1e-6)
    assert row[Tmeasy.MAX_X : Tmeasy.MAX_X + 2] == pytest.approx([0.89965 * load / 2, 0.77751 * load], rel=1e-6)
    assert row[Tmeasy.TRAIL_ZERO_SLIP] == 0.36484
    assert row[Common.ROLLING_RESISTANCE] == pytest.approx(0.015 * 0.4699)
    assert row[Common.PATCH_MASS_X] == pytest.approx(6.69 / 0.4699**2)


def test_car_guess_and_pressure():
    given = {"load": 10000.0, "rim_radius": 0.2, "use_pressure": 2e5, "design_pressure": 2.5e5}
    row = tire_vector(bare("tmeasy", pattern="car", **given))
    nominal = 5000.0 * 0.8**0.8
    assert row.values[Tmeasy.NOMINAL_LOAD] == pytest.approx(nominal)
    assert row.values[Tmeasy.SLOPE_Y : Tmeasy.SLOPE_Y + 2] == pytest.approx([15.9826 * nominal, 25.7018 * nominal])
    # the stiffness is that of the rated load
    assert row.values[Common.STIFFNESS] == pytest.approx(10000.0 / (0.16 * 0.2699))


def test_load_indices():
    assert len(BEARABLE_MASS) == 280
    assert list(BEARABLE_MASS) == sorted(BEARABLE_MASS)
    known = {0: 45, 50: 190, 91: 615, 100: 800, 108: 1000, 150: 3350, 200: 14000, 279: 136000}
    assert {index: BEARABLE_MASS[index] for index in known} == known
    row = tire_vector(bare("tmsimple", pattern="truck", load_index=108, rim_radius=0.2095))
    assert row.values[Tmsimple.NOMINAL_LOAD] == pytest.approx(4905.0)


def test_given_values_replace_those_of_the_pattern():
    guess = row_of("tmeasy").values
    row = row_of("tmeasy", max_x=(9000.0, 15000.0), vertical_stiffness=3e5, damping_ratio=1.0).values
    assert list(row[Tmeasy.MAX_X : Tmeasy.MAX_X + 2]) == [9000.0, 15000.0]
    assert row[Common.STIFFNESS] == 3e5
    assert row[Common.DAMPING] == pytest.approx(2 * guess[Common.DAMPING])
    assert row[Tmeasy.MAX_Y] == guess[Tmeasy.MAX_Y]
    # a nominal load scales the pattern
    heavy = row_of("tmeasy", nominal_load=10000.0).values
    assert heavy[Tmeasy.MAX_X] == pytest.approx(8996.5)


def test_all_values_without_a_pattern():
    names = [entry.name.lower() for entry in list(Tmeasy)[1:]]
    given = {name: (1.0 + k, 2.0 + k) for k, name in enumerate(names)}
    rated = {"nominal_load": 4e3, "load_limit": 1e4, "vertical_stiffness": 2e5, "vertical_damping": 1e3}
    row = tire_vector(bare("tmeasy", rim_radius=0.2, **rated, **given))
    assert [row.values[entry + 1] for entry in list(Tmeasy)[1:]] == [2.0 + k for k in range(len(names))]
    del given["trail"]
    with pytest.raises(SpecError, match=r"parameters\.trail: missing"):
        tire_vector(bare("tmeasy", rim_radius=0.2, **rated, **given))


def test_rows_of_the_other_models():
    row = row_of("fiala")
    assert (row.model, row.contact, row.state_size) == (TireModel.FIALA, TireContact.SINGLE_POINT, 2)
    assert row.values[Fiala.CORNERING_STIFFNESS] == 50000.0
    start = int(row.values[Common.CURVE_START])
    assert list(row.values[start:]) == [0, 0, 0.05, 29000, 0.1, 58000, 0.15, 87000, 0.2, 116000, 0.25, 145000]
    row = row_of("pacejka89", contact="envelope")
    assert row.contact == TireContact.ENVELOPE
    assert (row.values[Pac89.A + 3], row.values[Pac89.B + 10], row.values[Pac89.C]) == (2613.924, 0.0, 2.34)
    # 1022.112 F - 15.77615 F² is largest at 32.394 kN
    assert row.values[Common.LOAD_LIMIT] == pytest.approx(32394.2, rel=1e-5)
    assert row_of("pacejka89", load_limit=9e3).values[Common.LOAD_LIMIT] == 9e3
    row = row_of("lugre", disc_count=5)
    assert row.state_size == 10
    assert list(row.values[Lugre.BRISTLE_STIFFNESS : Lugre.VISCOSITY + 2]) == [181, 60, 1, 0.1, 0.02, 0.002]


def test_property_file():
    row = row_of("pacejka2002", measured_side="left").values
    assert row[Pac02.PKY1] == -10.289
    assert row[Pac02.LFZO] == 0.580904846
    assert row[Pac02.LKYG] == 1.0
    assert row[Pac02.AT_PRESSURE_MUX] == 1.0
    assert row[Pac02.MODE] == 4.0
    # VERTICAL_STIFFNESS x LCZ
    assert row[Common.STIFFNESS] == pytest.approx(441900.0)
    assert row[Common.LOAD_LIMIT] == 78750.0


def test_pressure_of_a_property_file():
    tir = properties(IP=1e6, PPX1=0.4, PPX2=-0.2, PPY2=0.1, QPFZ1=0.5, QSY8=-0.5)
    row = row_of("pacejka2002", tir=tir).values
    assert row[Pac02.AT_PRESSURE_KX] == pytest.approx(1 + 0.4 * 0.25 - 0.2 * 0.0625)
    assert row[Pac02.AT_PRESSURE_PKY2] == pytest.approx(1.025)
    assert row[Pac02.AT_PRESSURE_MY] == pytest.approx(1.25**-0.5)
    assert row[Common.STIFFNESS] == pytest.approx(441900.0 * 1.125)


def test_a_property_file_in_other_units_is_the_same_tire():
    """Millimetres, kilonewtons and milliseconds."""
    tir = properties(LENGTH="mm", FORCE="knewton", TIME="millisecond")
    for key, factor in {
        "UNLOADED_RADIUS": 1e3, "WIDTH": 1e3, "FNOMIN": 1e-3, "FZMIN": 1e-3, "FZMAX": 1e-3, "VERTICAL_STIFFNESS": 1e-6,
        "VERTICAL_DAMPING": 1e-3, "LONGVL": 1.0,
    }.items():  # fmt: skip
        tir[key] *= factor
    assert row_of("pacejka2002", tir=tir).values == pytest.approx(row_of("pacejka2002").values, rel=1e-12)


@pytest.mark.parametrize(
    ("changes", "options", "side"),
    [
        ({"TYRESIDE": "LEFT"}, {}, "left"),
        ({"TYRESIDE": "Right "}, {}, "right"),
        ({"TYRESIDE": "SYMMETRIC"}, {}, None),
        ({"TYRESIDE": "LEFT"}, {"measured_side": "right"}, "right"),
        ({"TYRESIDE": "LEFT"}, {"measured_side": "either"}, None),
        ({"TYRESIDE": "LEFT", "USE_MODE": -4.0}, {}, None),
    ],
)
def test_the_side_of_a_property_file(changes, options, side):
    assert row_of("pacejka2002", tir=properties(**changes), **options).measured_side == side


def test_a_file_without_a_side_is_mirrored_on_none():
    tir = properties()
    del tir["TYRESIDE"]
    assert row_of("pacejka2002", tir=tir).measured_side is None


def test_a_symmetric_file_has_no_asymmetric_coefficients():
    plain = row_of("pacejka2002").values
    symmetric = row_of("pacejka2002", tir=properties(TYRESIDE="SYMMETRIC")).values
    image = row_of("pacejka2002", tir=properties(USE_MODE=-4.0)).values
    odd = np.zeros(len(plain), bool)
    odd[[Pac02[key] for key in ASYMMETRIC]] = True
    assert np.array_equal(symmetric, np.where(odd, 0.0, plain))
    assert np.array_equal(image, np.where(odd, -plain, plain))


@pytest.mark.parametrize("mode", [0, 1, 2, 3, 4, 10, 11, 12, 13, 14, 114, 314])
def test_modes_of_a_property_file(mode):
    relaxation = {"PTX1": 2.0, "PTY1": 2.0, "PTY2": 2.0}
    row = row_of("pacejka2002", tir=properties(USE_MODE=float(mode), **relaxation))
    assert row.values[Pac02.MODE] == mode % 10
    assert row.values[Pac02.TRANSIENT] == (mode % 100 >= 10)
    assert row.state_size == (4 if mode % 100 >= 10 else 2)


def test_formats_of_a_property_file():
    """PAC2002 and MF-Tyre 5.2: sign of PDY3, speed of the rolling resistance, combined slip."""
    ours = row_of("pacejka2002", combined=None).values
    theirs = row_of(
        "pacejka2002", combined=None, tir=properties(PROPERTY_FILE_FORMAT="MF-TYRE", FITTYP=5.0, LONGVL=16.7)
    ).values
    changed = {Pac02(int(k)).name for k in np.flatnonzero(ours != theirs)}
    assert changed == {"MUY_CAMBER", "REFERENCE_SPEED"}
    assert (theirs[Pac02.MUY_CAMBER], theirs[Pac02.REFERENCE_SPEED], theirs[Pac02.ELLIPSE]) == (-1.0, 16.7, 0.0)
    assert ours[Pac02.REFERENCE_SPEED] == pytest.approx(np.sqrt(9.81 * 0.4699))
    bare_of_weights = {key: value for key, value in properties().items() if not key.startswith("R")}
    bare_of_weights |= {key: value for key, value in properties().items() if key.startswith("RIM")}
    assert row_of("pacejka2002", combined=None, tir=bare_of_weights).values[Pac02.ELLIPSE] == 1.0


def test_ranges_of_a_property_file():
    tir = properties(KPUMIN=-0.5, KPUMAX=0.6, ALPMIN=-3.15, ALPMAX=0.4, CAMMIN=-0.1, CAMMAX=0.2, FZMIN=500.0)
    row = row_of("pacejka2002", tir=tir).values
    assert list(row[Pac02.KPUMIN : Pac02.FZMIN + 1]) == pytest.approx(
        [-0.5, 0.6, -np.pi / 2 + 0.01, 0.4, -0.1, 0.2, 500.0]
    )
    assert row[Common.CAMBER_LIMIT] == 0.2
    # a limit that is given counts before the file's
    row = row_of("pacejka2002", tir=tir, camber_limit=0.03).values
    assert (row[Pac02.CAMMIN], row[Pac02.CAMMAX]) == (-0.03, 0.03)
    for key in ("KPUMIN", "KPUMAX", "ALPMIN", "ALPMAX", "CAMMIN", "CAMMAX", "FZMIN"):
        del tir[key]
    row = row_of("pacejka2002", tir=tir).values
    assert list(row[Pac02.KPUMIN : Pac02.KPUMAX + 1]) == [-1.0, 1.0]
    assert row[Pac02.CAMMAX] == pytest.approx(np.deg2rad(3.0))


def test_property_file_on_disk(tmp_path):
    """Sections, comments, quotes and any order: the file gives the same row as its keys in JSON."""
    tir = properties()
    lines = ["$ a tire", "[UNITS]"]
    lines += [f"{k} = '{v}'  $ text" if isinstance(v, str) else f" {k}= {v!r} ! number" for k, v in tir.items()]
    (tmp_path / "some.tir").write_text("\n".join(reversed(lines)) + "\n")
    description = json.loads((DATA / "pacejka2002.json").read_text())
    description["parameters"]["tir"] = {"file": "some.tir"}
    (tmp_path / "tire.json").write_text(json.dumps(description))
    row = tire_vector(read_spec(Tire, tmp_path / "tire.json"))
    assert np.array_equal(row.values, row_of("pacejka2002").values)
    (tmp_path / "some.tir").write_text("[X]\nPCX1 = 1.0e\n")
    with pytest.raises(SpecError, match=r"some\.tir: line 2: PCX1"):
        read_spec(Tire, tmp_path / "tire.json")


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("FNOMIN = -4850", "line 2: FNOMIN: must be positive, got -4850.0"),
        (
            "PROPERTY_FILE_FORMAT = 'PAC89'",
            "line 2: PROPERTY_FILE_FORMAT: must be one of 'PAC2002', 'MF-TYRE', 'MF_05', got 'PAC89'",
        ),
        ("LENGTH = 'mile'", "line 2: LENGTH: must be one of 'meter', 'm', 'mm', "),
        (
            "ANGLE = 'degree'",
            "line 2: ANGLE: must be one of 'radian', 'radians', 'rad', got 'degree'; convert the file",
        ),
        (
            "TYRESIDE = 'BOTH'",
            "line 2: TYRESIDE: must be one of 'LEFT', 'RIGHT', 'SYMMETRIC', got 'BOTH'; name the side",
        ),
        (
            "USE_MODE = 24",
            "line 2: USE_MODE: must not ask for nonlinear relaxation with a contact mass, got 24; give 0",
        ),
        ("USE_MODE = 25", "line 2: USE_MODE: must not ask for turn slip, got 25; give 0 (F_z), 1 (F_x)"),
        ("USE_MODE = 34", "line 2: USE_MODE: must not ask for a belt as a rigid ring, got 34"),
        ("USE_MODE = 7", "line 2: USE_MODE: must be one of 0, 1, 2, 3, 4 or 10 more, got 7"),
        ("USE_MODE = 4.5", "line 2: USE_MODE: must be a whole number below 1000, got 4.5"),
        ("KPUMIN = 0.1", "line 2: KPUMIN: must not be positive, got 0.1; give the least value of the measurement"),
        ("ALPMAX = -0.5", "line 2: ALPMAX: must be above ALPMIN -1.5708 and not negative, got -0.5; give the largest"),
        ("FZMIN = -1", "line 2: FZMIN: must not be negative, got -1.0; give the least load"),
        ("LMUV = 0.5", "line 2: LMUV: must be 0, got 0.5; it scales friction that falls with the speed of sliding"),
        ("LMUY = 0", "line 2: LMUY: must be positive, got 0.0; give LMUY of the measured tire"),
        ("LKY = 0", "line 2: LKY: must not be 0, got 0.0; mode 4 divides by that slope; give it or another mode"),
        ("PKY2 = 0", "line 2: PKY2: must not be 0, got 0.0"),
        ("PKX1 = 0", "line 2: PKX1: must not be 0, got 0.0"),
        ("PCX1 = 1.5\nPCX1 = 1.6", "line 3: PCX1: must be given once, got 1.5 in line 2 and 1.6 in line 3; leave one"),
        ("PCX1 = 1.5\nPCX1 = much", "line 3: PCX1: must be a number or quoted text, got 'much'"),
        ("PDX1 1.2", "line 2: must be KEY = value, a [SECTION], a row of numbers or a comment after $, got 'PDX1 1.2'"),
        ("= 1.2", "line 2: must be KEY = value"),
        ("PDX 1 = 1.2", "line 2: must be KEY = value"),
        ("LCX = inf", "line 2: LCX: must be a finite number, got inf"),
    ],
)
def test_lines_of_a_property_file_that_are_wrong(tmp_path, line, message):
    tir = {key: value for key, value in properties().items() if key != line.split()[0]}
    lines = ["[SHAPE]", line, "{radial width}", " 1.0 0.0", "(COMMENTS)", "'some tire'"]
    lines += [f"{key} = {value!r}" for key, value in tir.items()]
    (tmp_path / "some.tir").write_text("\n".join(lines))
    description = json.loads((DATA / "pacejka2002.json").read_text())
    description["parameters"]["tir"] = {"file": "some.tir"}
    (tmp_path / "tire.json").write_text(json.dumps(description))
    with pytest.raises(SpecError) as caught:
        read_spec(Tire, tmp_path / "tire.json")
    assert str(caught.value).startswith(f"some.tir: {message}")


REFUSED = [
    ("tmeasy", {"patern": "truck"}, r"parameters\.patern: unknown key \(did you mean 'pattern'\?\)"),
    ("tmeasy", {"pattern": "van", "rim_radius": 0.2}, r"parameters\.pattern: must be one of 'truck', 'car'"),
    ("tmeasy", {"pattern": "truck"}, r"parameters\.rim_radius: missing"),
    ("tmeasy", {"pattern": "truck", "rim_radius": 0.2}, r"parameters\.load: missing"),
    ("tmeasy", {"pattern": "truck", "rim_radius": 0.5, "load": 1e4}, r"parameters\.rim_radius: must be less than"),
    ("tmeasy", {"pattern": "truck", "rim_radius": 0.2, "load": -1.0}, r"parameters\.load: must be positive"),
    ("tmeasy", {"pattern": "truck", "rim_radius": 0.2, "load_index": 280}, r"parameters\.load_index: must be from 0"),
    ("tmeasy", {"rim_radius": 0.2}, r"parameters\.nominal_load: missing"),
    ("tmsimple", {"rim_radius": 0.2, "trail": (0.1, 0.1)}, r"parameters\.trail: unknown key"),
    ("tmeasy", {"blend": (3.0, 1.0)}, r"parameters\.blend: must be two increasing numbers"),
    ("tmeasy", {"contact": "two-point"}, r"parameters\.contact: must be one of"),
    ("fiala", {"vertical_stiffness": 1e5}, r"parameters\.slip_stiffness: missing"),
    ("fiala", {"slip_stiffness": 1e5}, r"parameters\.vertical_stiffness: must be given, or vertical_curve"),
    ("fiala", {"vertical_curve": ((0.1, 0.0), (0.0, 1.0))}, r"parameters\.vertical_curve: must be two or more"),
    ("lugre", {"vertical_stiffness": 1e5, "disc_count": 40}, r"parameters\.disc_count: must be from 1 to 16"),
    ("pacejka2002", {"tir": {"FNOMIN": 4e3}}, r"parameters\.tir\.PCX1: missing"),
    ("lugre", {"vertical_stiffness": 1e5, "relaxation_length": (0.2, 0.5)}, r"relaxation_length: must be absent, got"),
    ("lugrey", {}, r"template: must be one of .* \(did you mean 'lugre'\?\)"),
]


@pytest.mark.parametrize(("template", "parameters", "message"), REFUSED, ids=[r[2][:40] for r in REFUSED])
def test_what_is_refused(template, parameters, message):
    with pytest.raises(SpecError, match=message) as error:
        tire_vector(bare(template, **parameters), "axles[0].tire")
    assert str(error.value).startswith("axles[0].tire.")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"LENGTH": "mile"}, r"tir\.LENGTH: must be one of 'meter'"),
        ({"PKX1": "much"}, r"tir\.PKX1: must be a number"),
        ({"UNLOADED_RADIUS": 0.3}, r"tir\.UNLOADED_RADIUS: must be the tire's radius"),
        ({"USE_MODE": 15.0}, r"tir\.USE_MODE: must not ask for turn slip, got 15"),
        ({"PROPERTY_FILE_FORMAT": "MF-TYRE", "FITTYP": 61.0}, r"tir\.FITTYP: must be 5 or 52, MF-Tyre 5\.2, got 61"),
        ({"PROPERTY_FILE_FORMAT": "MF_05", "LONGVL": 0.0}, r"tir\.LONGVL: must be positive, got 0"),
        ({"USE_MODE": 14.0, "PTX1": 0.0}, r"tir\.USE_MODE: must be below 10 where PTX1 is missing or 0, got 14\.0"),
        ({"FZMIN": 8e4}, r"tir\.FZMAX: must be above FZMIN 80000, got 78750"),
    ],
)
def test_what_is_refused_in_a_property_file(change, message):
    with pytest.raises(SpecError, match=message):
        row_of("pacejka2002", tir=properties(**change))


@pytest.mark.parametrize(("key", "mode"), [("PKX1", 2), ("LKX", 3), ("PKY1", 1), ("LKY", 0)])
def test_a_file_without_a_slope_serves_the_modes_that_do_not_need_it(key, mode):
    """Measurements of one direction alone leave the other at zero."""
    row = row_of("pacejka2002", mode=mode, tir=properties(**{key: 0.0}))
    tires = run(row, steady(row, slip=[0.0, 0.05], angle=[0.1, 0.0]))
    assert np.isfinite(tires.force_w.numpy()).all()
    assert np.isfinite(tires.torque_w.numpy()).all()


def test_a_mode_that_asks_for_lengths_the_file_lacks_is_named_as_it_was_given():
    with pytest.raises(
        SpecError, match=r"^tire\.parameters\.mode: must be below 10 where PTX1 is missing or 0, got 14:"
    ):
        row_of("pacejka2002", mode=14, tir=properties(PTX1=0.0))


def test_wrong_number_of_coefficients():
    with pytest.raises(SpecError, match=r"parameters\.lateral: must be 14 numbers"):
        row_of("pacejka89", lateral=(1.0, 2.0))


def test_shipped_tires_are_rows():
    assert all(np.isfinite(row_of(template).values).all() for template in TEMPLATES)
