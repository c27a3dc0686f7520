"""What a Simulation, a size or an argument of the wrong sort does: one line, and nothing is spoilt or allocated."""

import tracemalloc
from typing import Any, cast

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.types import ModelError
from simwarp.importers.chrono_sensors import load_chrono_sensor
from simwarp.sensors.cameras.camera import Camera, CameraConfig
from simwarp.sensors.cameras.image_processing import Imaging
from simwarp.sensors.cameras.lenses import FishEye
from simwarp.sensors.cameras.lights import Lighting, Lights, Sun
from simwarp.sensors.interface import Mount, Schedule
from simwarp.sensors.motion.encoders import Encoder
from simwarp.sensors.motion.force_sensor import LoadCell
from simwarp.sensors.motion.gps import GeoOrigin
from simwarp.sensors.motion.imu import Imu, ImuConfig
from simwarp.sensors.presets import load_config, load_sensor
from simwarp.sensors.ranging.beams import Beam, BeamTable, beam_grid
from simwarp.sensors.ranging.lidar import Lidar, LidarConfig
from simwarp.sensors.ranging.radar import Clusters, Radar, RadarConfig
from simwarp.sensors.scene import Scene, Visuals

HUB = Mount("wheel")


def scene(worlds: int = 1) -> Scene:
    builder = sw.ModelBuilder()
    wheel = builder.add_solid("wheel", "sphere", 0.3, mass=1.0)
    builder.add_joint_revolute("axle", sw.WORLD, wheel, axis=(0.0, 1.0, 0.0))
    return Visuals(builder).finalize(builder.finalize(worlds, "cpu"))


def message(make: Any) -> str:
    with pytest.raises(ModelError) as caught:
        make()
    found = str(caught.value)
    assert "\n" not in found
    assert "np.float64" not in found
    assert " object at 0x" not in found
    return found


# ---- a Simulation that refuses spoils nothing ------------------------------------------------------------------------


def test_sensors_are_free_after_a_simulation_that_was_refused():
    target, other = scene(), scene()
    camera, imu = Camera(target, HUB, CameraConfig(width=4, height=4)), Imu(target.model, HUB)
    cell, stranger = LoadCell(target.model, "axle"), Imu(other.model, HUB, name="stranger")
    late = Imu(target.model, HUB, ImuConfig(schedule=Schedule(rate=100.0, lag=1.0e6)), name="late")
    mine: list[Any] = [camera, imu, cell]
    assert "joint_reactions=True" in message(lambda: sw.Simulation(target.model, 0.01, sensors=mine))
    for bad in (stranger, late):
        refused = message(lambda bad=bad: sw.Simulation(target.model, 0.01, sensors=[*mine, bad], joint_reactions=True))
        assert f"'{bad.name}'" in refused
    with pytest.raises(ModelError):
        sw.Simulation(target.model, 0.01, sensors=mine, joint_reactions=True, solver=sw.SolverOptions(solver="none"))
    sim = sw.Simulation(target.model, 0.01, sensors=mine, joint_reactions=True)
    sim.step()
    assert imu.timestamp.numpy()[0] == pytest.approx(0.01, abs=1e-6)


def test_a_sensor_that_fails_while_it_is_recorded_is_free_again(monkeypatch):
    target = scene()
    imu = Imu(target.model, HUB)

    def fail(simulation: Any) -> Any:
        raise RuntimeError("out of memory")

    with monkeypatch.context() as patch:
        patch.setattr(imu, "_sample", fail)
        with pytest.raises(RuntimeError, match="out of memory"):
            sw.Simulation(target.model, 0.01, sensors=[imu])
    sw.Simulation(target.model, 0.01, sensors=[imu])


def test_what_is_no_list_of_sensors():
    target = scene()
    camera = Camera(target, HUB, CameraConfig(width=4, height=4))
    cases: list[tuple[Any, str]] = [
        (camera, "sensors must be a list, got a Camera; write sensors="),
        ("camera", "sensors must be a list, got 'camera'; "),
        ([Camera], "sensors must be sensors, got the class Camera among them; "),
        ([None], "sensors must be sensors, got None among them; "),
        ([HUB], "sensors must be sensors, got "),
    ]
    for sensors, told in cases:
        found = message(lambda sensors=sensors: sw.Simulation(target.model, 0.01, sensors=sensors))
        assert found.startswith(f"Simulation: {told}")


def test_a_snapshot_of_other_sensors():
    target = scene()
    one = sw.Simulation(target.model, 0.01, sensors=[Imu(target.model, HUB)])
    two = sw.Simulation(target.model, 0.01, sensors=[Camera(target, HUB, CameraConfig(width=4, height=4))])
    kept, before = one.snapshot(), two.state.body_x.numpy()
    assert message(lambda: two.restore(kept)).startswith("restore: the snapshot must be of a Simulation with the same")
    assert "got None" in message(lambda: one.restore(None))  # type: ignore[arg-type]
    assert (two.state.body_x.numpy() == before).all()
    wide = Imu(target.model, HUB, ImuConfig(outputs=("gyroscope",)))
    three = sw.Simulation(target.model, 0.01, sensors=[wide])
    assert "arrays of force elements and sensors: here" in message(lambda: three.restore(kept))
    one.restore(kept)


# ---- sizes -----------------------------------------------------------------------------------------------------------


def huge(target: Scene) -> dict[str, Any]:
    slow, many = Schedule(rate=10.0), Schedule(rate=100.0, lag=1.0e6)
    return {
        "width must be at most 32768, got 200000": lambda: Camera(
            target, HUB, CameraConfig(width=200_000, height=200_000)
        ),
        "width must be at most 32768, got 1000000000000": lambda: Camera(
            target, HUB, CameraConfig(width=10**12)
        ),
        "must be below 2 GiB": lambda: Camera(target, HUB, CameraConfig(width=32_000, height=32_000)),
        "at most 16777216 beams": lambda: Lidar(
            target, HUB, LidarConfig(schedule=slow, beams=beam_grid(100_000, 10_000))
        ),
        "got 1000000000000 x 4": lambda: beam_grid(10**12, 4),
        "got 100000 x 100000": lambda: BeamTable(azimuth=np.zeros(100_000), elevation=np.zeros(100_000)),
        "shorten the lag": lambda: sw.Simulation(
            target.model, 0.01, sensors=[Imu(target.model, HUB, ImuConfig(schedule=many))]
        ),
        "below 2^31 sub-steps": lambda: sw.Simulation(
            target.model, 1e-6, sensors=[Imu(target.model, HUB, ImuConfig(schedule=many))]
        ),
        "frames in waiting": lambda: sw.Simulation(
            target.model, 0.01, sensors=[Camera(target, HUB, CameraConfig(
                width=4000, height=4000, schedule=Schedule(rate=100.0, lag=1000.0), outputs=("depth",)
            ))]
        ),
    }  # fmt: skip


@pytest.mark.parametrize("told", huge(None))  # type: ignore[arg-type]
def test_what_is_too_large_is_refused_before_it_is_allocated(told):
    make = huge(scene())[told]
    tracemalloc.start()
    assert told in message(make)
    assert tracemalloc.get_traced_memory()[1] < 300e6
    tracemalloc.stop()


def test_frames_of_many_worlds_have_to_fit():
    target = scene(worlds=20_000)
    found = message(lambda: Camera(target, HUB, CameraConfig(width=8000, height=8000)))
    assert "the frames of 20000 worlds need" in found
    assert found.endswith("take fewer worlds, pixels or beams")


# ---- full turns that are rounded -------------------------------------------------------------------------------------


def test_a_rounded_full_turn_is_a_full_turn():
    assert FishEye(fov=6.28319).fov == 2.0 * np.pi
    exact = beam_grid(10, 4)
    for half in (3.1416, 3.14159, 3.1415):
        rounded = beam_grid(10, 4, azimuth=(half, -half))
        assert np.allclose(rounded.azimuth, exact.azimuth, atol=1e-4)
    assert np.abs(BeamTable(azimuth=[0.0], elevation=[1.5708]).elevation).max() == 0.5 * np.pi
    assert "at most 2 pi" in message(lambda: beam_grid(10, 4, azimuth=(3.15, -3.15)))
    assert "must be in (0, " in message(lambda: FishEye(fov=6.3))


# ---- arguments of another sort ---------------------------------------------------------------------------------------


def test_arguments_of_another_sort():
    target: Any = scene()
    model: Any = target.model
    small: Any = CameraConfig(width=4, height=4)
    lidar: Any = LidarConfig(schedule=Schedule(rate=10.0), beams=beam_grid(4, 2))
    word, hub = cast(Any, "sun"), cast(Any, HUB)
    Radar(target, HUB, RadarConfig(schedule=Schedule(rate=10.0), rays=beam_grid(4, 2), clusters=Clusters()))
    cases: list[tuple[str, Any]] = [
        ("scene must be a Scene, got a Model; write visuals.finalize(model)", lambda: Camera(model, HUB, small)),
        ("model must be a Model, got a Scene; pass scene.model", lambda: Imu(target, HUB)),
        ("model must be a Model, got a Scene; pass scene.model", lambda: Encoder(target, "axle")),
        ("model must be a Model, got a Scene; pass scene.model", lambda: LoadCell(target, "axle")),
        ("config must be of class CameraConfig, got ", lambda: Camera(target, HUB, lidar)),
        ("config must be of class ImuConfig, got ", lambda: Imu(model, HUB, small)),
        ("config must be of class LidarConfig, got None; write LidarConfig(...)", lambda: Lidar(target, HUB, None)),
        ("config must be of class RadarConfig, got None; write RadarConfig(...)", lambda: Radar(target, HUB)),
        ("lens must be a lens, got 'sun'; ", lambda: Camera(target, HUB, CameraConfig(lens=word))),
        ("lights must be Lights or a Lighting, got 'sun'; ", lambda: Camera(target, HUB, small, lights=word)),
        ("outputs must be a list, got 5", lambda: Camera(target, HUB, CameraConfig(outputs=cast(Any, 5)))),
        ("builder must be a ModelBuilder, got a Model; ", lambda: Visuals(model)),
        ("coordinates must be joints by name or columns of joint_q, got ", lambda: Encoder(model, hub)),
    ]
    for told, make in cases:
        assert told in message(make)


def test_a_divergence_in_degrees():
    assert "Beam: divergence must be in [0, 1.5708], got 3.0" in message(lambda: Beam(divergence=3.0))
    Beam(divergence=1.0)


# ---- what is seen ----------------------------------------------------------------------------------------------------


def built(name: str = "wheel") -> tuple[sw.ModelBuilder, Visuals]:
    builder = sw.ModelBuilder()
    builder.add_solid(name, "sphere", 0.3, mass=1.0)
    return builder, Visuals(builder)


def test_visuals_with_a_model_of_another_builder():
    other, _ = built("hub")
    assert "include 'wheel', got one with 'hub' there; " in message(
        lambda: built()[1].finalize(other.finalize(1, "cpu"))
    )
    builder, visuals = built()
    early = builder.finalize(1, "cpu")
    builder.add_shape_box(0, half=(0.1, 0.1, 0.1))
    assert "which has 2 shapes, got one with 1; finalize this builder" in message(lambda: visuals.finalize(early))
    target = cast(Any, visuals.finalize(builder.finalize(1, "cpu")))
    assert "model must be a Model, got a Scene" in message(lambda: visuals.finalize(target))


def test_shapes_that_come_after_the_visuals_are_seen():
    builder, visuals = built()
    ball = visuals.add_sphere(0, radius=0.1, name="lamp")
    late = builder.add_shape_box(0, half=(0.1, 0.1, 0.1), name="late")
    last = visuals.add_sphere(0, radius=0.1, name="last")
    builder.add_shape_box(0, half=(0.1, 0.1, 0.1), name="latest")
    visuals.show(late, label=7)
    target = visuals.finalize(builder.finalize(1, "cpu"))
    assert (target.instance("lamp"), target.instance("last")) == (ball, last)
    assert target.names[1:] == ("lamp", "late", "last", "latest")
    assert target.label[target.instance("late")] == 7
    builder.add_shape_box(0, half=(0.1, 0.1, 0.1), name="lamp")
    assert message(lambda: visuals.add_sphere(0, radius=0.1)).startswith("visual 'lamp': the name must be unique")


def test_triangles_that_are_no_indices():
    corners = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)]
    cases: list[Any] = [[[0.5, 1.5, 2.5]], [[0, 1, float("nan")]], [["a", "b", "c"]], [[True, False, True]]]
    for triangles in cases:
        found = message(lambda triangles=triangles: built()[1].add_mesh(0, corners, triangles))
        assert found.startswith("mesh: triangles must be (T >= 1, 3) whole numbers, got ")
    built()[1].add_mesh(0, corners, [[0.0, 1.0, 2.0]])


def test_lights_have_to_fit_the_worlds():
    target = scene(worlds=4)
    small = CameraConfig(width=4, height=4)
    for worlds in (2, 7):
        lights = Lights(Lighting(), worlds, "cpu", per_world=("sun_direction",))
        found = message(lambda lights=lights: Camera(target, HUB, small, lights=lights))
        assert found.startswith(f"lights: 'sun_direction' must have 1 row or one for each of 4 worlds, got {worlds}; ")
    for worlds, wanted in ((1, ()), (4, ("sun_direction",))):
        Camera(target, HUB, small, lights=Lights(Lighting(), worlds, "cpu", per_world=wanted))
    assert "fog_density must be zero or positive" in message(lambda: Lighting(fog_density=-1.0))
    assert "suns must be a list of Sun" in message(lambda: Lighting(suns=cast(Any, Sun())))


# ---- words -----------------------------------------------------------------------------------------------------------


def test_the_remedy_is_that_of_the_mistake(tmp_path):
    target = scene()
    picture = cast(Any, np.zeros((64, 64, 3), np.uint8))
    found = message(lambda: built()[1].add_sphere(0, radius=0.1, texture=picture))
    assert found.endswith(
        "got an array of shape (64, 64, 3); give one of visuals: write texture=visuals.texture(ImageTexture(image=...))"
    )
    behind = message(lambda: Camera(target, HUB, CameraConfig(far=-5.0)))
    assert behind.endswith("far must be positive, got -5.0; give the largest distance that is seen [m]")
    assert message(lambda: Camera(target, HUB, CameraConfig(imaging=Imaging(gamma=0)))).startswith(
        "Imaging: gamma must be positive, got 0; give 1 for a linear response"
    )
    assert "got -1.0;" in message(lambda: built()[1].add_sphere(0, radius=cast(Any, np.float64(-1.0))))
    assert "got -1.0" in message(lambda: Schedule(rate=cast(Any, np.float64(-1.0))))


def test_numbers_that_do_not_fit_are_told_where_they_are_given():
    visuals = built()[1]
    found = message(lambda: visuals.add_sphere(0, radius=0.1, label=2**40))
    assert found.endswith(f"label must be at most 2147483647, got {2**40}; give an integer of 32 bits")
    target = scene()
    for body in (99, 10**8):
        assert f"got {body}" in message(lambda body=body: target.visuals.finalize(target.model, origin_body=body))
    assert "altitude" in message(lambda: GeoOrigin(altitude=-6378137.0))  # the middle of the earth has no latitude


def test_files_of_chrono_are_told_apart(tmp_path):
    file = tmp_path / "Lidar.json"
    file.write_text("""{ // of Chrono
      "Name": "scanner", "Type": "Sensor", "Template": "Lidar",
      "Properties": {"Update Rate": 10, "Width": 8, "Height": 2, "Horizontal Field of View": 6.28319,
        "Max Vertical Angle": 0.2, "Min Vertical Angle": -0.2, "Max Distance": 100.0},
      "Filters": []
    }""")
    assert message(lambda: load_config(file)) == (
        "Lidar.json: must be a file of simwarp, got one of Project Chrono; read it with "
        "simwarp.importers.chrono_sensors.load_chrono_sensor(path)"
    )
    assert load_chrono_sensor(file).beams.azimuth[-1] == pytest.approx(-0.75 * np.pi)
    found = message(lambda: load_chrono_sensor(cast(Any, 3)))
    assert found == "Chrono sensor: must be the path of a JSON file, got 3; pass a str or a Path"
    wheel = message(lambda: load_sensor("wheel-encoder", scene().model, Mount("wheel")))
    assert wheel.endswith("an encoder sits on a joint: pass its name")
