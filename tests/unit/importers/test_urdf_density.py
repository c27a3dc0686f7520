"""Masses of links that a URDF does not tell: by a density, from geometry, in closed form."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import simwarp as sw
from simwarp.importers.report import ImportedWarning
from tests.unit.importers.test_urdf_elements import INERTIAL, load

BARE = (
    INERTIAL,
    '<collision><origin xyz="0.1 0 0" rpy="0 0 0.7"/><geometry><box size="0.2 0.1 0.4"/></geometry></collision>',
)


def test_a_density_gives_the_mass_that_the_file_does_not_tell(tmp_path):
    """A box of 8 litres has 8 kg at 1000 kg/m³, and its inertia in closed form, turned; what the file tells stays."""
    with pytest.raises(sw.ModelError, match=r"massless link 'fore': .*, load with density=1000 .* or weld its joint"):
        load(tmp_path, BARE)
    arm = load(tmp_path, BARE, density=1000.0)
    fore = arm.builder.bodies[arm.bodies["fore"]]
    assert fore.mass == pytest.approx(8.0, rel=1e-12)
    x, y, z = 0.2, 0.1, 0.4
    local = 8.0 / 12.0 * np.diag([y * y + z * z, x * x + z * z, x * x + y * y])
    turn = Rotation.from_euler("z", 0.7).as_matrix()
    np.testing.assert_allclose(fore.inertia, turn @ local @ turn.T, rtol=1e-12, atol=1e-15)
    # the base is of 4 litres, and a part of the world
    assert arm.builder.bodies[arm.bodies["base"]].mass == pytest.approx(4.0, rel=1e-12)
    assert arm.builder.bodies[arm.bodies["upper"]].mass == 2.0
    assert {line.name for line in arm.report.held if line.element == "mass by density"} == {"base", "fore"}
    named = load(tmp_path, BARE, density={"fore": 500.0})
    assert named.builder.bodies[named.bodies["fore"]].mass == pytest.approx(4.0, rel=1e-12)
    assert "base" not in named.bodies


def test_a_mass_without_inertia_keeps_its_mass_and_centre(tmp_path):
    """The inertia is that of the geometry, scaled to the mass that is told."""
    given = '<inertial><origin xyz="0 0 0.05"/><mass value="2"/><inertia ixx="0" iyy="0" izz="0"/></inertial>'
    arm = load(tmp_path, (INERTIAL, given + BARE[1].replace('rpy="0 0 0.7"', "")), density=7800.0)
    fore = arm.builder.bodies[arm.bodies["fore"]]
    assert fore.mass == 2.0
    np.testing.assert_allclose(np.diag(fore.inertia), 2.0 / 12.0 * np.array([0.17, 0.2, 0.05]), rtol=1e-12)
    np.testing.assert_allclose(fore.pose.position, (0.0, 0.0, 0.55), atol=1e-12)


def extruded(outline):
    """A solid of height 1 over a polygon of corners that all see the first one."""
    import trimesh

    count = len(outline)
    vertices = [(x, y, z) for z in (0.0, 1.0) for x, y in outline]
    fan = [(0, k, k + 1) for k in range(1, count - 1)]
    faces = [(a, c, b) for a, b, c in fan] + [(a + count, b + count, c + count) for a, b, c in fan]
    for k in range(count):
        after = (k + 1) % count
        faces += [(k, after, after + count), (k, after + count, k + count)]
    return trimesh.Trimesh(vertices, faces, process=False)


@pytest.mark.parametrize("role", ["collision", "visual"])
@pytest.mark.parametrize("closed", [True, False])
def test_the_mass_of_a_mesh_is_that_of_its_solid(role, closed, tmp_path):
    """An L of three cubes has 3 litres; with a face taken out, its hull of 3.5 litres stands for it, and that is told.
    What is only seen counts where nothing touches.
    """
    import trimesh

    mesh = extruded([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)])
    if not closed:
        mesh = trimesh.Trimesh(mesh.vertices, mesh.faces[1:], process=False)
    mesh.export(tmp_path / "ell.stl")
    part = f'<{role}><geometry><mesh filename="ell.stl" scale="0.1 0.1 0.1"/></geometry></{role}>'
    arm_changes = (INERTIAL, part)
    if closed:
        arm = load(tmp_path, arm_changes, density=1000.0)
    else:
        with pytest.warns(ImportedWarning, match="mass by density 'fore': of hulls, where meshes are not closed"):
            arm = load(tmp_path, arm_changes, density=1000.0)
    # STL files have float32 corners
    assert arm.builder.bodies[arm.bodies["fore"]].mass == pytest.approx(3.0 if closed else 3.5, rel=1e-5)


def test_densities_that_cannot_be_used(tmp_path):
    for density, told in (
        (0.0, "density must be a number > 0 kg/m³"),
        ({"fore": -1.0}, "density must be a number > 0"),
        ({"for": 1.0}, "density names 'for' \\(did you mean 'fore'\\?\\), but the links are"),
    ):
        with pytest.raises(sw.ModelError, match=told):
            load(tmp_path, BARE, density=density)
