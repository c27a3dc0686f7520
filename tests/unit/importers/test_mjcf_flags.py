"""Flags of MJCF: each law that a flag switches off is off here, as MuJoCo has it; each flag is named in the report."""

import warnings

import mujoco
import numpy as np
import pytest

import simwarp as sw
from simwarp.importers import load_mjcf
from simwarp.importers.mjcf.mjcf_unsupported import LAWS, OTHERS, SETTINGS
from simwarp.importers.report import ImportedWarning

STEPS, DT = 100, 1e-3

SLIDES = """<mujoco><option timestep=".001" integrator="implicitfast">{flag}</option><default><geom size=".05"/>
  <joint type="slide" axis="1 0 0"/></default><worldbody>
  <body pos="0 0 0"><joint name="spring" stiffness="50" springref=".2"/><geom contype="0" conaffinity="0"/></body>
  <body pos="0 1 0"><joint name="damper" damping="3"/><geom contype="0" conaffinity="0"/></body>
  <body pos="0 2 0"><joint name="frictionloss" frictionloss="1"/><geom contype="0" conaffinity="0"/></body>
  <body pos="0 3 0"><joint name="limit" range="-1 .02" limited="true"/><geom contype="0" conaffinity="0"/></body>
  <body pos="0 4 0"><joint name="equality"/><geom contype="0" conaffinity="0"/></body>
  <body pos="0 5 0"><joint name="contact"/><geom/></body>
  <body pos=".12 5 0"><joint name="wall"/><geom density="1e7"/></body>
  <body pos="0 6 0"><joint name="gravity" axis="0 0 1"/><geom contype="0" conaffinity="0"/></body>
  <body pos="0 7 0"><joint name="actuation"/><geom contype="0" conaffinity="0"/></body>
  <body pos="0 8 0"><joint name="clampctrl"/><geom contype="0" conaffinity="0"/></body>
  <body pos="0 9 0"><joint name="parent"/><geom density="1e7"/>
    <body pos=".12 0 0"><joint name="filterparent" axis="-1 0 0"/><geom/></body></body></worldbody>
  <equality><joint joint1="equality"/></equality><actuator><motor name="pull" joint="actuation"/>
  <motor name="bounded" joint="clampctrl" ctrlrange="-1 1"/></actuator></mujoco>"""
RATE, CONTROL = 0.5, 3.0
UNHINDERED = ("damper", "frictionloss", "limit", "equality", "contact", "filterparent")
"""Slides that start at RATE; where their law is off they keep it, but for the last: that law lets its slide pass."""


def states(folder, flag):
    """Positions after 0.1 s by slide, ours and MuJoCo's; slides that run into something have a rate, none starts off
    its place.
    """
    text = SLIDES.format(flag=flag)
    file = folder / "slides.xml"
    file.write_text(text)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    rates = dict.fromkeys(UNHINDERED, RATE)
    for name, rate in rates.items():
        data.qvel[model.joint(name).dofadr[0]] = rate
    data.ctrl[:] = CONTROL
    for _ in range(STEPS):
        mujoco.mj_step(model, data)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ImportedWarning)
        robot = load_mjcf(file)
    finished = robot.builder.finalize(1, "cpu")
    elements = [sw.actuators.Actuators(finished, robot.actuators)] if robot.actuators else []
    sim = sw.Simulation(finished, DT, elements=elements)
    qd = np.zeros((1, finished.dof_count))
    for name, rate in rates.items():
        qd[0, robot.dofs[name]] = rate
    sim.set_joint_state(None, np.zeros_like(qd), qd)
    if elements:
        elements[0].set_from_action([[CONTROL] * len(robot.actuators)])
    sim.step(STEPS)
    ours = {name: float(sim.state.joint_q.numpy()[0, column]) for name, column in robot.dofs.items()}
    theirs = {name: float(data.qpos[model.joint(name).qposadr[0]]) for name in robot.dofs}
    return robot, ours, theirs


def test_every_law_acts_without_flags(tmp_path):
    _, ours, theirs = states(tmp_path, "")
    free = RATE * STEPS * DT
    for name in ("damper", "frictionloss", "limit", "equality", "contact"):
        assert ours[name] < 0.95 * free, name
    assert ours["filterparent"] == pytest.approx(free, rel=1e-4)
    # the other laws are smooth: first-order steps, 1 % of the way
    for name in ("damper", "spring", "gravity", "actuation", "clampctrl"):
        assert ours[name] == pytest.approx(theirs[name], rel=1e-2), name


@pytest.mark.parametrize("law", [*LAWS, "constraint"])
def test_a_law_that_a_flag_disables_is_off(law, tmp_path):
    """What is left of the slide's motion has a closed form, and is MuJoCo's: without the law nothing is soft in it."""
    robot, ours, theirs = states(tmp_path, f'<flag {law}="disable"/>')
    names = ("equality", "frictionloss", "limit", "contact") if law == "constraint" else (law,)
    for name in names:
        if law == "filterparent":
            assert ours[name] < 0.95 * RATE * STEPS * DT
            assert theirs[name] < 0.95 * RATE * STEPS * DT
            continue
        # 1e-5 m: float32 sums of 100 steps
        assert ours[name] == pytest.approx(theirs[name], abs=1e-5), name
        assert ours[name] == pytest.approx(free_motion(name), abs=1e-5), name
    told = [line for line in robot.report.held if line.element.startswith("flag ")]
    assert [line.element for line in told] == [f"flag {name}" for name in names]


def free_motion(name):
    """Position after 100 steps, semi-implicit: h a (1 + ... + n) under a constant acceleration."""
    mass = 1000.0 * 4.0 / 3.0 * np.pi * 0.05**3
    acceleration = CONTROL / mass if name == "clampctrl" else 0.0
    start = RATE if name in UNHINDERED else 0.0
    return start * STEPS * DT + acceleration * DT * DT * STEPS * (STEPS + 1) / 2


DISABLED = ("warmstart", "refsafe", "sensor", "midphase", "nativeccd", "multiccd", "eulerdamp", "autoreset", "island")
ENABLED = ("override", "energy", "fwdinv", "invdiscrete", "sleep", "diagexact")


@pytest.mark.parametrize("word", [*DISABLED, *ENABLED])
def test_every_other_flag_is_named_once(word, tmp_path):
    file = tmp_path / "flag.xml"
    state = "disable" if word in DISABLED else "enable"
    file.write_text(
        f'<mujoco><option><flag {word}="{state}"/></option><worldbody><body><joint/><geom size=".1"/></body>'
        "</worldbody></mujoco>"
    )
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        robot = load_mjcf(file)
    lines = [line for line in robot.report.lines if line.element == f"flag {word}"]
    assert len(lines) == 1
    assert len([one for one in told if issubclass(one.category, ImportedWarning)]) == (word in OTHERS)
    assert (word in SETTINGS) != (word in OTHERS)


def test_every_flag_of_this_mujoco_is_known():
    """A flag that a later MuJoCo adds is named by a warning; those of this one have an entry."""
    words = {
        name.partition("BL_")[2].lower()
        for kinds in (mujoco.mjtDisableBit, mujoco.mjtEnableBit)
        for name in kinds.__members__
        if "BL_" in name
    }
    assert words - {"constraint"} == {*LAWS, *SETTINGS, *OTHERS}


def test_groups_of_actuators_that_are_disabled_are_named(tmp_path):
    file = tmp_path / "groups.xml"
    file.write_text(
        '<mujoco><option actuatorgroupdisable="1"/><worldbody><body><joint name="j"/><geom size=".1"/></body>'
        '</worldbody><actuator><motor joint="j" group="1"/></actuator></mujoco>'
    )
    with pytest.warns(ImportedWarning, match="option actuatorgroupdisable: the actuators of all groups act"):
        load_mjcf(file)
