"""Tracked vehicles in a model: what is built, contacts of a shoe, laws of motion, statics as recorded, teeth."""

import collections
import dataclasses
import math
import re
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.rotation import rotate
from simwarp.model.model import meeting_pairs
from simwarp.vehicle.spec.parts import RigidPart, SpecError
from simwarp.vehicle.spec.track_parts import DoublePinShoe
from simwarp.vehicle.spec.tracked_vehicle_spec import TrackedVehicleSpec
from simwarp.vehicle.tracks.shoe_construction import SprocketContact, lay_track
from simwarp.vehicle.tracks.tracked_construction import add_tracked_vehicle
from simwarp.vehicle.tracks.tracked_files import load_tracked_vehicle
from tests.reference.sprockets import Profile, ball_in_sprocket
from tests.unit.vehicle.tracks.test_track_specs import DOUBLE
from tests.unit.vehicle.tracks.undriven_vehicles import undriven

SOLVER = sw.SolverOptions(max_iterations=100, fallback=False, refinement=0)


SPEC = undriven(load_tracked_vehicle("m113"))


def vehicle(
    spec=SPEC, gravity=(0.0, 0.0, -9.81), ground=True, worlds=1, sprocket=SprocketContact.TEETH, dt=1e-3, **options
):  # fmt: skip
    builder = sw.ModelBuilder(gravity=gravity)
    parts = add_tracked_vehicle(builder, spec, sprocket=sprocket, **options)
    if ground:
        builder.add_shape_plane(material=sw.Material(friction=0.9))
    model = builder.finalize(worlds, "cpu", contact_capacity=200)
    return sw.Simulation(model, dt, solver=SOLVER, check_start=False, joint_reactions=True), parts


def test_what_is_built():
    sim, parts = vehicle()
    builder = sim.model.builder
    assert sum(body.mass for body in builder.bodies) == pytest.approx(11342.9, abs=0.05)
    # chassis, then sprocket, carrier, idler, five arms with wheels, and shoes on each side
    assert len(parts.bodies) == len(builder.bodies) == 1 + 2 * 13 + 63 + 64
    assert (len(parts.left.shoes), len(parts.right.shoes)) == (63, 64)
    assert sim.model.topology.row_count == 4, "each chain is closed by two rows"
    com = np.sum([body.mass * body.pose.position for body in builder.bodies], axis=0) / 11342.94
    # printed by the recorded run, whose origin stands at x = -60, z = 0.62
    np.testing.assert_allclose(com, (-1.99754, -0.00171496, 0.62 + 0.232234), atol=2e-4)
    angles = [sim.joint_position(f"left.pin{k}") for k in range(1, 63)]
    np.testing.assert_allclose(angles, 0.0, atol=1e-14)  # of float64 poses


def test_paths_through_a_chain_are_short():
    """From the shoe half way around, to either side: 32 hinges and its six coordinates, and those of a wheel."""
    sim, _ = vehicle()
    assert sim.model.entry_count <= 2 * (64 // 2 + 6)


@pytest.mark.parametrize("sprocket", SprocketContact, ids=lambda kind: kind.value)
def test_a_shoe_has_three_contacts_with_each_partner_at_most(sprocket):
    """Two balls on a wheel or two rollers on a sprocket, and the guide."""
    sim, parts = vehicle(sprocket=sprocket)
    shapes = sim.model.builder.shapes
    for _ in range(5):
        sim.step(10)
        contacts = sim.contacts
        count = int(contacts.contact_count.numpy()[0])
        pairs = np.stack(
            [contacts.contact_shape0.numpy()[0, :count], contacts.contact_shape1.numpy()[0, :count]], axis=1
        )
        bodies = [tuple(sorted(shapes[shape].body for shape in pair)) for pair in pairs.tolist()]
        assert bodies
        assert max(collections.Counter(bodies).values()) <= 3
        shoes = {*parts.left.shoes, *parts.right.shoes}
        assert all(len(shoes & set(pair)) == 1 for pair in bodies), "shoes meet wheels and the ground, and nothing else"


def test_the_joints_hold_while_the_tensioners_snap():
    """270 kN are let go at once, and shoes turn with up to 100 rad/s. A step follows the curvature of its start: what
    it misses is at most h²/2 r w² for each of the two shoes of a pin, w being all the rate that comes and goes."""
    sim, _ = vehicle()
    lever, before = 0.5 * SPEC.left.shoe.pitch, 0.0
    for _ in range(60):
        sim.step()
        rate = float(np.linalg.norm(sim.state.body_omega.numpy()[0], axis=1).max())
        assert sim.diagnostics.position_error.numpy().max() < sim.dt**2 * lever * (before + rate) ** 2 + 1e-6
        before = rate


def test_no_momentum_comes_from_nowhere():
    """In free flight the tensioners pull chains, wheels and hull about, and the whole does not move: 11 t times the
    rounding of a velocity of 10 m/s in float32 (6e-7), summed over a hundred steps."""
    sim, _ = vehicle(gravity=(0.0, 0.0, 0.0), ground=False)
    mass = np.array([body.mass for body in sim.model.builder.bodies])
    sim.step(100)
    velocity = sim.state.body_v.numpy()[0]
    assert np.abs(velocity).max() > 0.1, "something moves"
    assert np.linalg.norm(mass @ velocity) < 11343 * 100 * 6e-7


def test_worlds_do_not_matter_to_each_other():
    alone, three = vehicle()[0], vehicle(worlds=3)[0]
    for sim in (alone, three):
        sim.step(20)
    states = three.state.body_x.numpy()
    for world in range(3):
        np.testing.assert_array_equal(states[world], alone.state.body_x.numpy()[0])


def test_two_vehicles_have_groups_of_their_own():
    builder = sw.ModelBuilder()
    for k in range(2):
        at = sw.pose((0.0, 5.0 * k, SPEC.start_height))
        add_tracked_vehicle(builder, SPEC, at=at, prefix=f"v{k}_")
    tracks = [name.format(k) for k in range(2) for name in ("v{}_left", "v{}_right")]
    met: dict[str, set[str]] = collections.defaultdict(set)
    for low, high in meeting_pairs(builder):
        names = sorted((builder.shapes[low].name, builder.shapes[high].name), key=lambda name: ".shoe" not in name)
        assert names[0].split(".")[0] == names[1].split(".")[0], "each track is by itself"
        part = names[0].rsplit(".", 1)[1].rstrip("01")
        met[part].add(re.sub(r"\d", "", names[1].split(".", 1)[1]))
    assert met == {"top": {"wheel", "idler"}, "roller": {"sprocket"},
                   "guide": {"wheel.groove", "idler.groove", "sprocket.groove"}}  # fmt: skip
    assert len({shape.group for shape in builder.shapes if shape.name.endswith("wheel0")}) == len(tracks)
    with pytest.raises(SpecError, match="prefix: must be one that no other vehicle has, got 'v0_' again"):
        add_tracked_vehicle(builder, SPEC, prefix="v0_")
    builder.add_shape_plane(mask=0, group=2**31 - 1)
    with pytest.raises(SpecError, match="v3_left: must find three free collision groups, got 0; use fewer tracks"):
        add_tracked_vehicle(builder, SPEC, prefix="v3_")


def test_springs_at_pins_straighten_the_chain():
    """At rest where two shoes are in line: the angle as laid is taken back by the rest angle."""
    spec = with_left(pin_stiffness=50.0, pin_damping=2.0)
    builder = sw.ModelBuilder()
    parts = add_tracked_vehicle(builder, spec, sprocket=SprocketContact.DRUM)
    for k in range(1, 63):
        dof = builder.joints[parts.chains[0].pins[k]].dofs[0]
        assert (dof.stiffness, dof.damping) == (50.0, 2.0)
        joint = builder.joints[parts.chains[0].pins[k]]
        before, after = (builder.bodies[body].pose.rotation for body in (joint.parent, joint.child))
        ahead = [rotate(q, np.array([1.0, 0.0, 0.0])) for q in (before, after)]
        turned = rotate(np.array([0.0, np.sin(0.5 * dof.rest), 0.0, np.cos(0.5 * dof.rest)]), ahead[1])
        np.testing.assert_allclose(turned, ahead[0], atol=1e-12)


SHOE: Any = SPEC.left.shoe
PAD = SHOE.wheel_pad
TWO_PINS = DoublePinShoe(
    mass=18.02, inertia=(0.22, 0.04, 0.25), length=0.0984, width=0.2781, height=0.06, ground_pad=PAD, wheel_pad=PAD,
    guide=(0.045, 0.0, 0.0375), friction=0.8, connector=RigidPart(mass=2.0, inertia=(0.1, 0.1, 0.1)),
    connector_length=0.054, connector_radius=0.02, connector_width=0.02,
)  # fmt: skip


def with_left(**changes):
    return dataclasses.replace(SPEC, left=dataclasses.replace(SPEC.left, **changes))


REFUSED: dict[str, tuple[TrackedVehicleSpec, Any, str]] = {
    "a word": (SPEC, "drum", "left.sprocket: must be a SprocketContact, got 'drum'; write SprocketContact.TEETH"),
    "shoes with two pins": (
        with_left(shoe=TWO_PINS, sprocket=DOUBLE, shoes=64),
        SprocketContact.DRUM,
        "left.shoe: 'track-double-pin' has no drum",
    ),
    "arcs without teeth": (
        with_left(sprocket=dataclasses.replace(SPEC.left.sprocket, teeth=12)),
        SprocketContact.TEETH,
        "left.sprocket: arcs must leave teeth between them",
    ),
    "thick rollers": (
        with_left(shoe=dataclasses.replace(SHOE, roller_radius=0.09)),
        SprocketContact.TEETH,
        "left.shoe.roller_radius: must be less than the sprocket's arc_radius 0.089 m, got 0.09",
    ),
    "an open chain": (
        with_left(shoes=61),
        SprocketContact.DRUM,
        "left.track: a chain of 61 shoes of 0.154 m does not close",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_not_there_is_refused_by_name(case):
    spec, sprocket, message = REFUSED[case]
    builder = sw.ModelBuilder()
    with pytest.raises(SpecError, match=message):
        add_tracked_vehicle(builder, spec, sprocket=sprocket)
    assert not builder.bodies


def test_a_chain_is_laid_clear_of_the_teeth():
    """One gap points straight down, the first pin is in it: all rollers have room left, which the tensioners take."""
    sim, _ = vehicle()
    shapes = sim.model.builder.shapes
    for side in ("left", "right"):
        track, toothed = getattr(SPEC, side), next(s for s in shapes if s.name == f"{side}.sprocket")
        sprocket, shoe = track.sprocket, track.shoe
        profile = Profile(center=sprocket.arc_center_radius, arc=sprocket.arc_radius, tip=sprocket.tip_radius,
                          teeth=sprocket.teeth, half_width=1.0)  # fmt: skip
        np.testing.assert_allclose(rotate(toothed.pose.rotation, np.array([1.0, 0.0, 0.0])), (0, 0, -1), atol=1e-15)
        np.testing.assert_allclose(rotate(toothed.pose.rotation, np.array([0.0, 0.0, 1.0])), (0, 1, 0), atol=1e-15)
        laid = lay_track(track)
        gaps = []
        for (x, z), angle in zip(laid.centres, laid.angles, strict=True):
            for along in (shoe.roller_front, shoe.roller_rear):
                # the sprocket's axes are -z, -x, y of the vehicle
                at = np.array([-(z + along * math.sin(angle)), -(x + along * math.cos(angle)), 0.0])
                touch = ball_in_sprocket(profile, at, shoe.roller_radius)
                gaps += [] if touch is None else [touch.gap]
        assert len(gaps) >= 10
        assert min(gaps) > 0.007


@pytest.mark.slow
def test_teeth_drive_the_track_without_slip():
    """The full torque of the recorded runs, 3 s: ten shoes go by in a turn of the sprocket, so that the hull moves as
    far as they are long; the pins hold, and guides stay between the discs. A gap leaves a roller some 25 mm of way."""
    sim, parts = vehicle(wheel_compliance=7.6e-7, ground_compliance=1.9e-6)
    sim.step(1500)
    force = sim.control.joint_force.numpy()
    for side in (parts.left, parts.right):
        force[0, sim.model.builder.dof_start(side.sprocket)] = 2253.0
    sim.control.joint_force.assign(force)
    start, turned = sim.body_position("chassis")[0], [sim.joint_position(s.sprocket) for s in (parts.left, parts.right)]
    worst = 0.0
    for _ in range(300):
        sim.step(10)
        worst = max(worst, float(sim.diagnostics.position_error.numpy().max()))
    way, teeth = sim.body_position("chassis")[0] - start, SPEC.left.sprocket.teeth
    assert way > 1.5
    for side, before in zip((parts.left, parts.right), turned, strict=True):
        passed = (sim.joint_position(side.sprocket) - before) / (2.0 * math.pi) * teeth * SPEC.left.shoe.pitch
        assert way == pytest.approx(passed, abs=0.05)
        places = sim.state.body_x.numpy()[0, list(side.shoes), 1]
        assert np.ptp(places) < 2.0 * SPEC.left.sprocket.backlash
    assert worst < 1e-4


@pytest.mark.slow
def test_it_stands_as_recorded():
    """Project Chrono, penalty contacts, 10 s at rest. Compliances are secants of its law of Hertz at the loads of the
    recorded run. 15 % of the pins' forces, 2 cm and 0.05 rad are what rigid teeth, and two contacts in the place of
    eight, change: a tensioner's force is 1 kN for each millimetre of the chain."""
    sim, parts = vehicle(wheel_compliance=7.6e-7, ground_compliance=1.9e-6)
    sim.step(4000)
    pins: dict[str, list[float]] = {"left": [], "right": []}
    for _ in range(50):
        sim.step(10)
        force = np.linalg.norm(sim.diagnostics.joint_reaction_force.numpy()[0], axis=1)
        for name, values in pins.items():
            values.append(force[list(getattr(parts, name).pins)].mean())
    assert np.mean(pins["left"]) == pytest.approx(91.0e3, rel=0.15)
    assert np.mean(pins["right"]) == pytest.approx(66.4e3, rel=0.15)
    x, q = sim.body_position("chassis"), sim.body_rotation("chassis")
    assert (x + rotate(q, parts.reference))[2] == pytest.approx(0.5932, abs=0.02)
    assert 2.0 * (q[3] * q[1] - q[0] * q[2]) == pytest.approx(0.0104, abs=0.005)
    for name, idler, arms in (
        ("left", -4.0391, (0.000, -0.172, -0.206, -0.225, -0.182)),
        ("right", -4.0860, (-0.088, -0.209, -0.228, -0.254, -0.227)),
    ):
        side = getattr(parts, name)
        assert -3.95 + sim.joint_position(side.tensioner) == pytest.approx(idler, abs=0.025)
        np.testing.assert_allclose([sim.joint_position(arm) for arm in side.arms], arms, atol=0.05)
