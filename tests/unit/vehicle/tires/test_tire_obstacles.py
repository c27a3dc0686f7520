"""Tires that meet static shapes: the envelope against its reference, and the laws of what it finds."""

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.types import WORLD, pose
from simwarp.vehicle import VEHICLE_SOLVER, Vehicle, add_vehicle, load_vehicle, per_world, with_options
from simwarp.vehicle.spec.vehicle_spec import SpecError
from simwarp.vehicle.tires.parameter_vector_kernels import Common, TireContact
from simwarp.vehicle.tires.tire_obstacles import TireObstacles
from simwarp.vehicle.tires.tires import Tires, ground, ground_of
from tests.reference.tire_obstacles import ball, box, capsule, envelope_of, half_space
from tests.reference.tires import unit
from tests.unit.vehicle.tires.tire_bench import DT, States, bench, product, quaternion, rotated, row_of, steady

ROW = row_of("tmeasy")
RADIUS, WIDTH = float(ROW.values[Common.RADIUS]), float(ROW.values[Common.WIDTH])
TURN = unit(np.array([0.2, -0.1, 0.3, 0.9]))
TURNED = np.stack([rotated(TURN, axis) for axis in np.eye(3)], axis=1)
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
TWELVE = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4],
          [1, 5, 7], [1, 7, 3]]  # fmt: skip
HALF = (0.3, 0.25, 0.1)


def empty():
    """A builder with a body, without which there is no model."""
    builder = sw.ModelBuilder()
    builder.add_body("wheel", mass=1.0, inertia=(1.0, 1.0, 1.0))
    return builder


def block(builder, kind, **place):
    """The same block as a box, a hull or a mesh."""
    if kind == "box":
        return builder.add_shape_box(WORLD, half=HALF, **place)
    if kind == "hull":
        return builder.add_shape_hull(WORLD, points=CORNERS * HALF, **place)
    return builder.add_shape_mesh(WORLD, vertices=CORNERS * HALF, triangles=TWELVE, **place)


def scene(kind):
    """Shapes at the origin, and the same solids for the reference."""
    builder = empty()
    if kind in ("box", "hull", "mesh"):
        block(builder, kind, pose=pose((0.1, 0.05, 0.0), rotation=tuple(TURN)))
        solids = [box(np.array([0.1, 0.05, 0.0]), TURNED, HALF)]
    elif kind == "sphere":
        builder.add_shape_sphere(WORLD, radius=0.25, pose=pose((0.05, -0.02, -0.1)))
        solids = [ball(np.array([0.05, -0.02, -0.1]), 0.25)]
    elif kind == "capsule":
        builder.add_shape_capsule(WORLD, radius=0.1, half_length=0.5, pose=pose((0.0, 0.0, 0.0), rotation=tuple(TURN)))
        solids = [capsule(-0.5 * TURNED[:, 2], 0.5 * TURNED[:, 2], 0.1)]
    elif kind == "height field":
        x = np.linspace(-2.0, 2.0, 41)
        builder.add_shape_height_field(WORLD, np.tile(0.1 * (x > -0.05), (41, 1)), size=(4.0, 4.0))
        solids = [lambda p: p[..., 2] - np.clip((p[..., 0] + 0.1) / 0.1, 0.0, 1.0) * 0.1]
    else:  # several at once, the ground too
        builder.add_shape_plane()
        builder.add_shape_sphere(WORLD, radius=0.3, pose=pose((0.3, 0.1, -0.2)))
        block(builder, "box", pose=pose((-0.5, 0.0, 0.0)))
        solids = [ball(np.array([0.3, 0.1, -0.2]), 0.3), box(np.array([-0.5, 0.0, 0.0]), np.eye(3), HALF)]
    return builder, [*solids, half_space(UP, -0.15 if kind != "several" else 0.0)]


UP = (0.0, 0.0, 1.0)


def tires_in(builder, worlds, *, height=0.0, shapes="all", row=ROW, **options):
    model = builder.finalize(worlds, "cpu", **options)
    terrain = ground("cpu", x=(0.0, 0.0, height))
    return bench(row, worlds, terrain=terrain, obstacles=TireObstacles(model, shapes)), model


def placed(x, q, spin=0.0):
    """Wheels at places and turns."""
    zero = np.zeros((len(x), 3))
    return States(np.asarray(x, dtype=float), np.asarray(q), zero, zero + np.array([0.0, spin, 0.0]))


def upright(count):
    return np.tile([0.0, 0.0, 0.0, 1.0], (count, 1))


@pytest.mark.parametrize("kind", ["box", "hull", "mesh", "sphere", "capsule", "height field", "several"])
def test_the_envelope_agrees_with_its_reference(kind):
    rng = np.random.default_rng(3)
    builder, solids = scene(kind)
    worlds = 12
    tires, _ = tires_in(builder, worlds, height=-0.15 if kind != "several" else 0.0)
    x = rng.uniform([-0.6, -0.2, 0.3], [0.6, 0.2, 0.45], size=(worlds, 3))
    q = np.stack(
        [
            product(quaternion((0, 0, 1), a), quaternion((1, 0, 0), b))
            for a, b in rng.uniform(-1, 1, (worlds, 2)) * [3, 0.2]
        ]
    )
    states = placed(x, q)
    tires.apply(DT, states.arrays())
    met = 0
    for w in range(worlds):
        expected = envelope_of(states.wheel(w), RADIUS, WIDTH, solids)
        normal, deflection = (np.zeros(3), 0.0) if expected is None else expected
        met += expected is not None
        # float32 of lengths of 0.5 m in 360 rays; one that grazes an edge may fall on its other side: a share of 1/2 mm
        assert abs(tires.envelopes.deflection.numpy()[w, 0] - deflection) < 5e-4
        if deflection > 2e-3:
            assert np.abs(tires.envelopes.normal.numpy()[w, 0] - normal).max() < 0.02
    close = [w for w in range(worlds) if abs(tires.deflection.numpy()[w, 0]) > 0.0]
    assert met >= worlds // 3
    assert len(close) >= worlds // 3


def test_flat_ground_is_what_the_single_point_finds():
    """Deflection within 1 % by rays of 2°, normal and camber, on leaning ground too, while all of the width touches."""
    states = steady(ROW, slip=0.05, angle=0.03, camber=[0.0, 0.05, -0.05])
    rotation = quaternion((0.6, 0.8, 0.0), 0.15)
    builder = empty()
    builder.add_shape_sphere(WORLD, radius=0.1, pose=pose((50.0, 0.0, 0.0)))
    model = builder.finalize(3, "cpu")
    for turned in ((0.0, 0.0, 0.0, 1.0), rotation):
        terrain = ground("cpu", rotation=turned)
        one = bench(ROW, 3, terrain=terrain)
        other = bench(ROW, 3, terrain=terrain, obstacles=TireObstacles(model))
        for tires in (one, other):
            tires.apply(DT, states.arrays())
        assert other.deflection.numpy() == pytest.approx(one.deflection.numpy(), rel=0.01)
        assert other.camber.numpy() == pytest.approx(one.camber.numpy(), abs=1e-4)
        normal = other.envelopes.normal.numpy()[:, 0]
        assert np.abs(normal - terrain.rot.numpy()[0][:, 2]).max() < 2e-3


def test_ground_that_is_met_twice_counts_once():
    """A floor of boxes flush with the ground, and the plane as a shape: the ground alone."""
    states = placed(np.array([[0.0, 0.0, 0.45], [0.9, 0.0, 0.44]]), upright(2))
    found = []
    for twice in (False, True):
        builder = empty()
        builder.add_shape_plane(name="floor")
        builder.add_shape_box(WORLD, half=(1.0, 1.0, 0.5), pose=pose((0.0, 0.0, -0.5)), name="slab")
        tires, _ = tires_in(builder, 2, shapes="all" if twice else [])
        tires.apply(DT, states.arrays())
        found.append(tires.deflection.numpy())
    # a box's rays are cut at slabs, a plane's at its height: rounding alone
    assert found[1] == pytest.approx(found[0], rel=1e-4)


def kerb(height=0.1):
    builder = empty()
    builder.add_shape_box(WORLD, half=(1.0, 2.0, height), pose=pose((1.0, 0.0, 0.0)), name="kerb")
    return builder


def test_a_kerb_pushes_back_and_up_and_grows_with_what_it_takes():
    """A wheel 10 mm above the ground moves 0.2 m into the edge of a kerb of 0.1 m, in steps of 1 mm."""
    x = np.linspace(-0.4, -0.2, 201)
    tires, _ = tires_in(kerb(), len(x), height=-0.01)
    tires.apply(DT, placed(np.stack([x, 0.0 * x, 0.0 * x + RADIUS], axis=-1), upright(len(x))).arrays())
    deflection = tires.deflection.numpy()[:, 0]
    touch = -np.sqrt(RADIUS**2 - (RADIUS - 0.1) ** 2)
    assert np.all(deflection[x < touch] == 0.0)
    into = x > touch + 0.01
    # rays 16 mm apart see an edge in turn, so that there are flat parts; it never falls but by rounding
    assert np.all(np.diff(deflection[into]) > -1e-6)
    # 1 mm of way is 1 mm of deflection at most; a ray more or less is some 0.5 mm
    assert np.abs(np.diff(deflection)).max() < 2.5e-3
    force = tires.force_w.numpy()[into, 0]
    assert np.all(force[:, 0] < 0.0)
    assert np.all(force[:, 2] > 0.0)
    normal = tires.envelopes.normal.numpy()[into, 0]
    # at first touch it is the direction from the edge to the centre
    edge = np.array([touch, 0.0, RADIUS - 0.1]) / RADIUS
    assert np.abs(normal[0] - edge).max() < 0.05


def test_the_walls_of_a_ditch_hold_a_wheel_from_both_sides():
    builder = empty()
    for side in (-1.0, 1.0):
        builder.add_shape_box(WORLD, half=(1.0, 2.0, 0.5), pose=pose((1.25 * side, 0.0, -0.5)))
    x = np.array([0.0, 0.02, -0.02])
    # the corners of a gap of 0.5 m are at this height below the centre
    height = np.sqrt(RADIUS**2 - 0.25**2) - 0.02
    tires, _ = tires_in(builder, 3, height=-0.8)
    tires.apply(DT, placed(np.stack([x, 0.0 * x, 0.0 * x + height], axis=-1), upright(3)).arrays())
    force = tires.force_w.numpy()[:, 0]
    assert abs(force[0, 0]) < 1e-3 * force[0, 2]
    assert force[0, 2] > 1000.0
    # out of the middle it is pushed back, as much to either side
    assert force[1, 0] < -100.0
    assert force[1, 0] == pytest.approx(-force[2, 0], rel=1e-3)


def test_what_is_beside_the_wheel_is_not_met():
    builder = empty()
    builder.add_shape_box(WORLD, half=(1.0, 1.0, 0.2), pose=pose((0.0, 1.0 + 0.51 * WIDTH, 0.0)))
    builder.add_shape_sphere(WORLD, radius=0.3, pose=pose((0.0, -3.0, 0.3)))
    tires, _ = tires_in(builder, 1, height=-1.0)
    tires.apply(DT, placed([[0.0, 0.0, RADIUS]], upright(1)).arrays())
    assert tires.load.numpy()[0, 0] == 0.0


def test_each_world_has_its_shapes_where_it_has_them():
    """`shape_x` of each world, written between steps; and a world does what it does alone, bitwise."""
    tires, model = tires_in(kerb(), 3, per_world=["shape_x"])
    states = placed(np.tile([0.0, 0.0, 0.45], (3, 1)), upright(3), spin=4.0)
    model.shape_x.assign(np.array([[[1.0, 0.0, 0.0]], [[1.3, 0.0, 0.0]], [[9.0, 0.0, 0.0]]]))
    tires.apply(DT, states.arrays())
    force = tires.force_w.numpy()[:, 0].copy()
    assert force[0, 0] < force[1, 0] - 10.0
    assert tires.load.numpy()[1, 0] > tires.load.numpy()[2, 0]
    for w, place in enumerate((1.0, 1.3, 9.0)):
        alone, own = tires_in(kerb(), 1, per_world=["shape_x"])
        own.shape_x.assign(np.array([[[place, 0.0, 0.0]]]))
        alone.apply(DT, placed(states.x[:1], upright(1), spin=4.0).arrays())
        assert np.array_equal(alone.force_w.numpy()[0, 0], force[w])


@pytest.mark.parametrize("template", ["tmeasy", "tmsimple", "fiala", "pacejka89", "pacejka2002", "lugre"])
def test_every_force_law_stands_on_shapes(template):
    """On a box as on the ground: the load of the single point, within the 1 % of the deflection and its power."""
    row = row_of(template)
    states = steady(row, slip=0.03, angle=0.02, load=8000.0)
    builder = empty()
    builder.add_shape_box(WORLD, half=(2.0, 2.0, 0.5), pose=pose((0.0, 0.0, -0.5)))
    tires, _ = tires_in(builder, 1, height=-1.0, row=row)
    plain = bench(row, 1)
    for _ in range(200):
        tires.apply(DT, states.arrays())
        plain.apply(DT, states.arrays())
    assert tires.force_w.numpy() == pytest.approx(plain.force_w.numpy(), rel=0.03, abs=20.0)


def test_where_nothing_is_asked_for_nothing_is_spent():
    """The search for envelopes is a launch of its own, and tires without obstacles have no room for one."""
    builder = sw.ModelBuilder()
    parts = add_vehicle(builder, load_vehicle("hmmwv"))
    builder.add_shape_plane()
    model = builder.finalize(1, "cpu", per_world=per_world())
    plain, meeting = Vehicle(parts, model), Vehicle(parts, model, obstacles="all")
    assert isinstance(plain.tires, Tires)
    assert isinstance(meeting.tires, Tires)
    assert plain.tires.envelopes.normal.size == 0
    assert plain.tires.obstacle_tables is None
    assert set(plain.tires.tables.contact.numpy()) == {TireContact.SINGLE_POINT}
    assert set(meeting.tires.tables.contact.numpy()) == {TireContact.SHAPES}
    launches = [len(car.record(sw.Simulation(model, 1e-3), 1e-3)) for car in (plain, meeting)]
    assert launches == [2, 3]


def test_obstacles_that_are_refused():
    builder = sw.ModelBuilder()
    parts = add_vehicle(builder, with_options(load_vehicle("hmmwv"), tire="rigid"))
    builder.add_shape_plane(name="floor")
    builder.add_shape_sphere(0, radius=0.1, name="lamp")
    model = builder.finalize(1, "cpu", per_world=per_world())
    with pytest.raises(SpecError, match=r"^obstacles: must be left out with 'rigid' tires"):
        Vehicle(parts, model, obstacles="all")
    with pytest.raises(SpecError, match=r"^obstacles: no shape is called 'flor'; there are floor"):
        TireObstacles(model, ["flor"])
    with pytest.raises(SpecError, match=r"^obstacles: shape 'lamp' must be on WORLD"):
        TireObstacles(model, ["lamp"])
    with pytest.raises(SpecError, match=r"^obstacles: shape 'floor' must be named once, it is named twice"):
        TireObstacles(model, ["floor", "floor"])
    assert TireObstacles(model).shapes == (model.shape_names.index("floor"),)


def test_a_field_as_ground_and_as_a_shape():
    """`ground_of` a height field that is an obstacle, too: the same as one of them."""
    x = np.linspace(-2.0, 2.0, 41)
    builder = empty()
    builder.add_shape_height_field(WORLD, np.tile(0.05 * np.sin(3.0 * x), (41, 1)), size=(4.0, 4.0), name="field")
    model = builder.finalize(2, "cpu")
    states = placed([[0.0, 0.0, 0.46], [0.7, 0.1, 0.44]], upright(2))
    found = []
    for terrain, shapes in ((ground_of(model, "field"), []), (ground_of(model, "field"), "all"),
                            (ground("cpu", x=(0.0, 0.0, -3.0)), "all")):  # fmt: skip
        tires = bench(ROW, 2, terrain=terrain, obstacles=TireObstacles(model, shapes))
        tires.apply(DT, states.arrays(), model.assets)
        found.append(tires.envelopes.deflection.numpy())
    assert found[0].min() > 0.005
    assert found[1] == pytest.approx(found[0], rel=1e-5)
    assert found[2] == pytest.approx(found[0], rel=1e-5)


# ---- a vehicle on force laws beside the same on rigid tires, which meet shapes by contact ---------------------------


def course(builder, kind):
    """A kerb of 0.1 m, a ditch of 0.6 m across, or three stones of different heights under the wheels' tracks."""
    if kind == "kerb":
        builder.add_shape_plane()
        builder.add_shape_box(WORLD, half=(2.0, 3.0, 0.05), pose=pose((7.0, 0.0, 0.05)))
    elif kind == "ditch":
        for x in (-6.0, 14.6):
            builder.add_shape_box(WORLD, half=(10.0, 3.0, 0.5), pose=pose((x, 0.0, -0.5)))
    else:
        builder.add_shape_plane()
        for x, y, radius in ((4.5, 0.91, 0.2), (5.5, -0.9, 0.2), (6.5, 0.95, 0.25)):
            builder.add_shape_sphere(WORLD, radius=radius, pose=pose((x, y, 0.1 - radius)))


def hubs_over(kind, tire):
    """Way (N,) and rise (N,) of the left wheels' hubs of a HMMWV that rolls at 2 m/s over a course."""
    builder = sw.ModelBuilder()
    parts = add_vehicle(builder, with_options(load_vehicle("hmmwv"), tire=tire), speed=2.0)
    course(builder, kind)
    model = builder.finalize(1, "cpu", per_world=per_world())
    obstacles = None if tire == "rigid" else "all"
    below = ground("cpu", x=(0.0, 0.0, -5.0 if kind == "ditch" else 0.0))
    car = Vehicle(parts, model, ground=below, obstacles=obstacles)
    sim = sw.Simulation(model, 1e-3, elements=[car], solver=VEHICLE_SOLVER)
    car.input.assign(np.array([[0.0, 0.12, 0.0, 0.0]], np.float32))
    hubs = [side.spindle for side in parts.sides][::2]
    rows = []
    for _ in range(500):
        sim.step(10)
        rows.append(sim.state.body_x.numpy()[0, hubs].copy())
    path = np.array(rows)
    return path[:, :, 0], path[:, :, 2] - path[60, :, 2]


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "height"), [("kerb", 0.1), ("stones", 0.1), ("ditch", -0.1)])
def test_hubs_take_the_way_that_rigid_tires_take(kind, height):
    """They rise and fall as those on rigid cylinders, but for what tires give: 20 mm at rest, and some 30 mm more on an
    edge, under a third of their width or when they land.
    """
    (soft_x, soft), (hard_x, hard) = hubs_over(kind, "tmeasy"), hubs_over(kind, "rigid")
    for wheel in range(2):
        ends = max(soft_x[60, wheel], hard_x[60, wheel]), min(soft_x[-1, wheel], hard_x[-1, wheel])
        grid = np.linspace(*ends, 500)
        a, b = (np.interp(grid, x[:, wheel], z[:, wheel]) for x, z in ((soft_x, soft), (hard_x, hard)))
        assert np.sqrt(np.mean((a - b) ** 2)) < 0.02
        top, bottom = abs(a.max() - b.max()), abs(a.min() - b.min())
        assert max(top, bottom) < 0.04
        assert 0.8 * abs(height) < (b.max() if height > 0.0 else -b.min()) < 1.1 * abs(height)


@pytest.mark.slow
def test_without_obstacles_a_kerb_is_not_there():
    """Wheels drive through what stands on their ground."""
    builder = sw.ModelBuilder()
    parts = add_vehicle(builder, load_vehicle("hmmwv"), speed=2.0)
    course(builder, "kerb")
    model = builder.finalize(1, "cpu", per_world=per_world())
    car = Vehicle(parts, model)
    sim = sw.Simulation(model, 1e-3, elements=[car], solver=VEHICLE_SOLVER)
    hub = parts.sides[0].spindle
    start = float(sim.state.body_x.numpy()[0, hub, 2])
    sim.step(2500)
    assert float(sim.state.body_x.numpy()[0, hub, 0]) > 5.2
    assert abs(float(sim.state.body_x.numpy()[0, hub, 2]) - start) < 0.03
