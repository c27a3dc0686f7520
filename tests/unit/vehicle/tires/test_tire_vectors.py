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
from simwarp.vehicle.tires.tires import tire_vector
from tests.unit.vehicle.tires.tire_bench import DATA, TEMPLATES, properties, row_of


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
        ("PROPERTY_FILE_FORMAT = 'PAC89'", "line 2: PROPERTY_FILE_FORMAT: must be 'PAC2002', got 'PAC89'"),
        ("LENGTH = 'mm'", "line 2: LENGTH: must be 'meter', got 'mm'"),
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
        ({"LENGTH": "mm"}, r"tir\.LENGTH: must be 'meter'"),
        ({"PKX1": "much"}, r"tir\.PKX1: must be a number"),
        ({"UNLOADED_RADIUS": 0.3}, r"tir\.UNLOADED_RADIUS: must be the tire's radius"),
        ({"USE_MODE": 12.0}, r"mode: must be one of 0, 1, 2, 3, 4"),
    ],
)
def test_what_is_refused_in_a_property_file(change, message):
    with pytest.raises(SpecError, match=message):
        row_of("pacejka2002", tir=properties(**change))


def test_wrong_number_of_coefficients():
    with pytest.raises(SpecError, match=r"parameters\.lateral: must be 14 numbers"):
        row_of("pacejka89", lateral=(1.0, 2.0))


def test_shipped_tires_are_rows():
    assert all(np.isfinite(row_of(template).values).all() for template in TEMPLATES)
