"""Crane: a slewing crane sets a load that hangs from a cable down on a pad, softly, in wind.

The cable is a rod of geometrically exact elements (docs/flexible.md): it swings, bends, stretches and goes slack. The
winch changes the elements' length at rest, ``joint_rest``, in every physics step, all by the same; the cable's mass
stays what it is built with. Jib and trolley follow commanded speeds within the forces of their drives.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar, Final

import torch
import warp as wp

import simwarp as sw
from simwarp.tasks import (
    ComputedRows,
    Curriculum,
    Drawing,
    Driver,
    Fraction,
    Ge,
    Le,
    Line,
    Mirror,
    Mode,
    NamedRows,
    NotNegative,
    Positive,
    Range,
    RewardWeights,
    Task,
    TaskConfig,
    filled,
    launch_over,
    reflection,
    register,
    share_over,
    zeros_of,
)

from . import crane_kernels as kernels
from .crane_kernels import Crane, CraneStart, CraneState, Verdicts
from .framework.recorded_launches import WorldLaunch

BOOM_HEIGHT: Final = 14.0
"""Of the trolley above the ground [m]."""
REACH: Final = (3.0, 13.0)
"""Of the trolley from the crane's axis [m]."""
PLACE: Final = 8.0
"""Of the trolley as built [m]."""
LENGTHS: Final = (3.0, 13.8)
"""Shortest and longest cable [m]: it comes to hang slack where the load stands."""
PLACES: Final = (4.0, 12.0)
"""Of trolley and pad at the start [m]."""
START_LENGTHS: Final = (5.0, 10.0)
"""Of the cable at the start [m]."""
NEAR_LENGTHS: Final = (11.5, 12.7)
"""The same at a curriculum's level 0 [m]: the load is 0.3 to 1.5 m above the pad."""
BUILT_LENGTH: Final = 8.0
"""Of the cable as built [m]."""
CABLE_DIAMETER: Final = 0.01
"""[m]."""
WIRE_ROPE: Final = sw.flex.Elastic(young=1.0e11, density=6000.0, damping_time=0.02)
"""Of the cable: strands of steel, half as stiff as solid steel."""
LOAD_MASS: Final = 400.0
"""Of the load in the middle of its range [kg]."""
LOAD_HALF: Final = 0.5
"""Half the side of the load [m]."""
DRAG_AREA: Final = 1.2
"""Drag coefficient times area of the load [m²]."""
PAD_RADIUS: Final = 0.9
"""Of the painted pad [m]."""
SLEW_DAMPING: Final = 1.0e7
"""Torque of the slewing drive per error of speed [N·m·s/rad]."""
SLEW_TORQUE: Final = 1.0e5
"""Its largest torque [N·m]."""
TROLLEY_DAMPING: Final = 1.0e5
"""Force of the trolley's drive per error of speed [N·s/m]."""
TROLLEY_FORCE: Final = 5.0e3
"""Its largest force [N]."""
BRAKES: Final = (0.0, 0.5, 0.8)
"""Deceleration at which trolley and hoist come to rest at the ends of their ways [m/s²]."""

_NAMES: Final = (
    "slewing rate", "trolley place", "trolley speed", "cable length", "cable speed", "pad ahead", "pad left",
    "load ahead", "load left", "load height", "load velocity ahead", "load velocity left", "load velocity up",
    "load lean ahead", "load lean left", "cable lean ahead", "cable lean left", "tension", "slew command",
    "trolley command", "hoist command",
)  # fmt: skip
_ACTIONS: Final = ("slew", "trolley", "hoist")


@dataclasses.dataclass(frozen=True)
class CraneRewards(RewardWeights):
    """Weights of the reward."""

    approach: float = 1.0
    """Way by which the load comes nearer in a step [m]: over the ground, half of what it is too high, all of what it is
    too low. It should be as high as it is far away, at most 3 m."""
    landing: float = 10.0
    """At a touch that ends the episode: mean of nearness, half at ``tolerance``, and softness, half at 0.2 m/s."""
    placed: float = 10.0
    """The load stands on the pad."""
    haste: float = -0.5
    """Speed of the load beyond 0.2 m/s and half a metre per second for each metre from the pad [m/s]."""
    sway: float = -0.03
    """Square of the load's horizontal speed against the trolley's [m²/s²], at most 4."""
    action_rate_l2: float = -0.05
    """Mean square of the change of the action."""
    time: float = -0.01
    """Every step."""


@dataclasses.dataclass(frozen=True)
class CraneConfig(TaskConfig):
    """Configuration of the crane."""

    dt: Positive = 0.01
    """Physics step [s]."""
    decimation: Annotated[int, Ge(1), Le(100_000)] = 20
    """Physics steps per control step; one action lasts decimation * dt seconds."""
    max_episode_steps: Annotated[int, Ge(1), Le(10**9)] = 175
    """Control steps after which an episode is truncated: 35 s."""
    action_rise_time: NotNegative | tuple[NotNegative, ...] = (3.0, 2.0, 1.0)
    """Time in which slewing, trolley and hoist get from rest to their largest speeds [s]."""
    randomise: dict[str, Range] = dataclasses.field(
        default_factory=lambda: {"body_mass": Range(0.5, 2.0, mode=Mode.SCALE, only="load")}
    )
    """Model parameter -> range: by default the load's mass, 200 to 800 kg."""
    rewards: CraneRewards = CraneRewards()
    """Weights of the reward."""
    gravity: float = 9.81
    """Gravitational acceleration, downwards [m/s2]."""
    cable_elements: Annotated[int, Ge(1), Le(200)] = 6
    """Elements of the cable."""
    numerical_damping: Fraction = 1.0
    """Of the cable (`simwarp.flex.Options`): at 1 a cable that is jerked taut makes no energy."""
    slew_speed: Positive = 0.1
    """Of a full action [rad/s]."""
    trolley_speed: Positive = 1.0
    """Of a full action [m/s]."""
    hoist_speed: Positive = 0.8
    """Of a full action, which lowers the load [m/s]."""
    start_slew: NotNegative = 0.4
    """Half-width of the uniform direction of the boom at the start [rad]."""
    target_slew: NotNegative = 0.7
    """Half-width of the uniform direction of the pad [rad]."""
    start_swing: Annotated[float, Ge(0.0), Le(0.5)] = 0.08
    """Half-width of the uniform lean of the cable at the start, both ways [rad]."""
    start_swing_rate: NotNegative = 0.06
    """Half-width of its uniform rate [rad/s]."""
    wind: NotNegative = 8.0
    """Strongest mean wind; each episode has one below it, from any side [m/s]."""
    gusts: NotNegative = 0.3
    """Standard deviation of the gusts, as a share of the mean wind."""
    gust_time: Positive = 3.0
    """Time in which a gust falls to a third [s]."""
    tolerance: Positive = 0.2
    """Distance of the load from the middle of the pad within which it may touch the ground [m]."""
    touch_down: Positive = 0.3
    """Largest speed of a touch [m/s]."""
    hold_time: NotNegative = 0.5
    """Time through which the load stands on the pad, the cable slack, for a success [s]."""


@register("crane")
class CraneTask(Task[CraneConfig]):
    """Observation ``policy`` (W, 21), in this order; ahead is along the boom, left across it.

    Slewing rate [rad/s]; the trolley's distance from the axis [m] and speed [m/s]; length of the cable [m] and how fast
    it grows; the pad from the trolley, ahead and left [m]; the load's underside from the pad, ahead, left and up [m];
    the load's velocity, likewise [m/s]; lean of the load under the trolley, and of the cable at its top, ahead and
    left, as slopes; tension of the cable [kN]; the actions in force. Actions are speeds of slewing (left), trolley
    (out) and hoist (down), as shares of the largest ones.
    """

    fused_physics: ClassVar[bool] = True
    summary: ClassVar[str] = "crane: a load on a flexible cable is set down in wind, 21 observations, 3 speeds"
    instruction: ClassVar[str] = "Set the hanging load down on the painted pad."
    config_type: ClassVar[type[TaskConfig]] = CraneConfig
    action_size: int = 3
    action_names: ClassVar[Sequence[str]] = _ACTIONS
    observation_names: ClassVar[Mapping[str, Sequence[str]]] = {"policy": _NAMES}
    per_world: ClassVar[tuple[str, ...]] = ("joint_rest", "shape_x")
    success_reasons: ClassVar[frozenset[str]] = frozenset({"placed"})
    training: ClassVar[Mapping[str, Any]] = {
        "iterations": 160,
        "num_envs": 128,
        "steps_per_iteration": 32,
        "network.hidden": (128, 64),
        "network.init_std": 0.3,
        "network.init_mean": (0.0, 0.0, 0.2),
        "ppo.gamma": 0.995,
        "ppo.symmetry": "augment",
        "ppo.entropy": 0.0,
    }

    trained_in: ClassVar[Mapping[str, Any]] = {"curriculum": Curriculum(driver=Driver.PROGRESS, up=0.1, down=0.025)}

    @property
    def action_scale(self) -> Sequence[float]:
        """Speeds of full actions [rad/s, m/s, m/s]."""
        return (self.config.slew_speed, self.config.trolley_speed, self.config.hoist_speed)

    def build(self, builder: sw.ModelBuilder) -> None:
        """A boom that slews, a trolley on it, a cable, and a load over the ground with a pad."""
        top = BOOM_HEIGHT
        builder.add_shape_plane(sw.WORLD, name="ground")
        self.pad = builder.add_shape_cylinder(  # paint: it touches nothing
            sw.WORLD, radius=PAD_RADIUS, half_length=0.01, name="pad", group=2, mask=2, pose=sw.pose((PLACE, 0.0, 0.0))
        )
        boom = builder.add_body("boom", mass=3000.0, inertia=(2e3, 1e5, 1e5), pose=sw.pose((0.0, 0.0, top)))
        trolley = builder.add_body(
            "trolley", mass=200.0, inertia=(30.0, 30.0, 30.0), pose=sw.pose((PLACE, 0.0, top))
        )  # fmt: skip
        slewing = sw.PositionDrive(stiffness=0.0, damping=SLEW_DAMPING, effort_limit=SLEW_TORQUE)
        rolling = sw.PositionDrive(stiffness=0.0, damping=TROLLEY_DAMPING, effort_limit=TROLLEY_FORCE)
        builder.add_joint_revolute("slew", sw.WORLD, boom, axis=(0, 0, 1), anchor=(0.0, 0.0, top), drive=slewing)
        builder.add_joint_prismatic("rail", boom, trolley, axis=(1, 0, 0), anchor=(PLACE, 0.0, top), drive=rolling)
        end = top - BUILT_LENGTH
        self.cable = builder.add_rod(
            "cable", [(PLACE, 0.0, top), (PLACE, 0.0, end)], elements=self.config.cable_elements,
            section=sw.flex.Round(diameter=CABLE_DIAMETER), material=WIRE_ROPE, start=sw.flex.Hinge("trolley"),
        )  # fmt: skip
        inertia = LOAD_MASS * (2.0 * LOAD_HALF) ** 2 / 6.0
        load = builder.add_body(
            "load", mass=LOAD_MASS, inertia=(inertia,) * 3, pose=sw.pose((PLACE, 0.0, end - LOAD_HALF))
        )  # fmt: skip
        builder.add_shape_box(load, half=(LOAD_HALF,) * 3, name="load")
        builder.add_joint_fixed("hook", self.cable.bodies[-1], load, anchor=(PLACE, 0.0, end))

    def flex_options(self) -> sw.flex.Options:
        """``numerical_damping`` of the cable."""
        return sw.flex.Options(numerical_damping=self.config.numerical_damping)

    def setup(self) -> None:
        """Allocate the state of an episode, and record what a control step launches."""
        config, simulation = self.config, self.simulation
        state, model, control = simulation.state.arrays, simulation.model, simulation.control
        self.episode = zeros_of(CraneState, self, last_action=self.action_size)
        self.crane = self._make_crane()
        self.verdicts = zeros_of(Verdicts, self)
        self._verdicts = {name: sw.to_torch(getattr(self.verdicts, name)) for name in ("placed", "hard", "missed")}
        self._error, self._touch_speed = (torch.zeros(self.num_worlds, device=self.device) for _ in range(2))
        self._start_q, self._start_qd = (wp.zeros_like(control.joint_force) for _ in range(2))
        self._target = sw.to_torch(self.episode.target)
        rest, draws = model.joint_rest, self.random.draws
        moved = [self.crane, state, self.episode]
        outputs = [control.joint_target_qd, control.body_force]
        self._begin_crane = launch_over(
            self, kernels.begin_crane, config.gust_time / config.control_dt, config.gusts, self.random.stream("gusts"),
            draws, self.action, *moved,
        )  # fmt: skip
        self._drive = launch_over(self, kernels.drive_crane, self.action, *moved, *outputs)
        self._finish = launch_over(self, kernels.finish_physics_step, self.action, *moved, *outputs, rest)
        judged = kernels.finish_control_step if self.fused_physics else kernels.judge_crane
        arguments = [*moved, self.verdicts, rest] if self.fused_physics else [self.crane, self.episode, self.verdicts]
        self._judge = launch_over(self, judged, *arguments)
        self._observe = ComputedRows(self, kernels.observe_crane, self.action, *moved, width=len(_NAMES))
        named = config.reward_weights()
        weights = filled(kernels.CraneRewardWeights, **named)
        self._compute_rewards = NamedRows(
            self, kernels.compute_crane_rewards, named, weights, self.action, *moved, self.verdicts
        )
        streams = [self.random.stream(purpose) for purpose in ("places", "winds")]
        self._start = launch_over(
            self, kernels.begin_crane_episode, self._every_world, self.drawn_level, self._make_start(), *streams,
            draws, self.crane, self.episode, self.verdicts, rest, model.shape_x, self._start_q, self._start_qd,
        )  # fmt: skip
        self._still = launch_over(self, kernels.still_crane, self._every_world, *moved, *outputs)
        self._show = launch_over(self, kernels.show_crane, self.crane, self.episode, rest, model.shape_x)
        self._measure = launch_over(self, kernels.measure_crane, *moved, self._error, self._touch_speed)

    def _make_crane(self) -> Crane:
        """Return what the crane is."""
        config, model, cable = self.config, self.simulation.model, self.cable
        starts = model.joint_dof_start
        axial = [int(starts[joint]) for joint in cable.joints]
        return filled(
            Crane,
            trolley=model.body("trolley"), load=model.body("load"), first=cable.bodies[0], second=cable.bodies[1],
            shape=list(model.shape_names).index("load"), pad=self.pad,
            slew=model.dof("slew"), rail=model.dof("rail"), hinge=int(starts[cable.ends[0]]),
            axial=wp.array(axial, dtype=int, device=str(self.device)),
            built=BUILT_LENGTH, middle=LOAD_HALF,
            reach=wp.vec2(*REACH), place=PLACE, lengths=wp.vec2(*LENGTHS),
            speed=wp.vec3(*self.action_scale), brake=wp.vec3(*BRAKES),
            area=DRAG_AREA, gravity=config.gravity, dt=config.dt, tolerance=config.tolerance,
            touch_down=config.touch_down, hold_steps=math.ceil(config.hold_time / config.dt),
            force=self.simulation.contacts.shape_contact_force, mass=model.body_mass,
            stiffness=model.joint_stiffness, damping=model.joint_damping,
        )  # fmt: skip

    def _make_start(self) -> CraneStart:
        """Return what an episode begins with."""
        config = self.config
        return filled(
            CraneStart, slew=config.start_slew, target=config.target_slew, places=wp.vec2(*PLACES),
            lengths=wp.vec2(*START_LENGTHS), near_lengths=wp.vec2(*NEAR_LENGTHS), swing=config.start_swing,
            swing_rate=config.start_swing_rate, wind=config.wind, spread=config.gusts,
        )  # fmt: skip

    # ---- a control step ------------------------------------------------------------------------------------------

    def begin_step(self) -> None:
        """Store the last action and the way that is left; the wind changes."""
        self._begin_crane.launch()

    def apply(self, action: torch.Tensor) -> None:
        """Turn the boom, move the trolley and pay cable out, at shares of their largest speeds."""
        self._drive.on(action)

    def physics_launches(self) -> Sequence[WorldLaunch]:
        """Return the actions' way, the drives, and what a physics step has led to."""
        path, simulation = self._path, self.simulation
        control, rest = simulation.control, simulation.model.joint_rest
        parts = [self.crane, simulation.state.arrays, self.episode, control.joint_target_qd, control.body_force, rest]
        return [share_over(simulation, kernels.crane_on, path.reach, path.request, self.action, *parts)]

    def after_physics(self) -> None:
        """Notice touches, pay out the cable of a physics step, drive on."""
        self._finish.launch()

    def finish_physics(self) -> None:
        """Notice what the last step has led to, and judge the state reached."""
        self._judge.launch()

    def observations(self) -> dict[str, torch.Tensor]:
        """Return ``policy`` (W, 21) float32, the buffer itself."""
        return {"policy": self._observe()}

    def rewards(self) -> dict[str, torch.Tensor]:
        """Return the terms of the reward."""
        return self._compute_rewards()

    def terminations(self) -> dict[str, torch.Tensor]:
        """Return ``placed``, the success; ``hard``, a touch that was too fast; ``missed``, one beside the pad."""
        return {name: flag.clone() for name, flag in self._verdicts.items()}

    def reset(self, world_mask: torch.Tensor) -> None:
        """Hang a swinging load anywhere, over ground with the pad elsewhere, in another wind."""
        self._start.on(world_mask)
        self.simulation.set_joint_state(world_mask, self._start_q, self._start_qd)
        self._still.on(world_mask)

    def metrics(self) -> dict[str, torch.Tensor]:
        """Return the ``error`` of the load's place [m] and the fastest touch, ``touch_speed`` [m/s]."""
        self._measure.launch()
        return {"error": self._error, "touch_speed": self._touch_speed}

    def extra_state(self) -> dict[str, torch.Tensor]:
        """The state of the episode: cable, pad, wind, touches."""
        names: Mapping[str, Any] = CraneState.vars  # type: ignore[attr-defined]
        return {name: sw.to_torch(getattr(self.episode, name)) for name in names}

    def load_extra_state(self, state: Mapping[str, torch.Tensor]) -> None:
        """Load it; place the pad and the cable's length."""
        for name, values in self.extra_state().items():
            values.copy_(state[name])
        self._show.launch()

    def mirror(self) -> Mirror:
        """Left is right."""
        return Mirror(
            {"policy": reflection(_NAMES, flip=["slewing rate", "* left", "slew command"])},
            reflection(_ACTIONS, flip=["slew"]),
        )

    # ---- pictures ------------------------------------------------------------------------------------------------

    def visuals(self, visuals: sw.sensors.Visuals) -> None:
        """Show mast, boom, trolley and cable."""
        yellow, grey = (0.85, 0.55, 0.04), (0.25, 0.26, 0.28)
        visuals.show(self.pad, color=(0.7, 0.08, 0.06))
        visuals.add_box(sw.WORLD, half=(0.45, 0.45, 0.5 * BOOM_HEIGHT), pose=sw.pose((0, 0, 0.5 * BOOM_HEIGHT)),
                        color=yellow)  # fmt: skip
        visuals.add_box(sw.WORLD, half=(1.6, 1.6, 0.25), pose=sw.pose((0, 0, 0.25)), color=grey)
        boom, trolley = 0, 1
        visuals.add_box(boom, half=(0.5 * REACH[1] + 0.4, 0.25, 0.2), pose=sw.pose((0.5 * REACH[1], 0, 0.5)),
                        color=yellow)  # fmt: skip
        visuals.add_box(boom, half=(2.0, 0.3, 0.2), pose=sw.pose((-2.2, 0, 0.5)), color=yellow)
        visuals.add_box(boom, half=(0.7, 0.6, 0.7), pose=sw.pose((-3.6, 0, 0.0)), color=grey)
        visuals.add_box(trolley, half=(0.4, 0.4, 0.12), pose=sw.pose((0, 0, 0.15)), color=grey)
        # Elements change their length: each node shows as much as the longest has, away from the ends of the cable
        half = 0.5 * LENGTHS[1] / self.config.cable_elements
        middle = 0.5 * self.config.cable_elements
        for number, body in enumerate(self.cable.bodies):
            if number != middle:
                along = half if number < middle else -half
                visuals.add_cylinder(
                    body, radius=0.04, half_length=half, color=(0.05, 0.05, 0.05),
                    pose=sw.pose((along, 0.0, 0.0), (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))),
                )  # fmt: skip

    def shot(self) -> sw.viewer.Shot:
        """From the side, at rest: crane, load and pad are in sight."""
        return sw.viewer.Shot(body=sw.WORLD, target=(5.0, 0.0, 7.0), eye=(7.0, -29.0, 4.0), fov=0.85)

    def drawing(self) -> Drawing:
        """Draw how far the load is from its pad."""
        load = self.views.body_q[:, self.crane.load, :3]
        left = torch.stack([load, self._target.float()], dim=1)
        return Drawing((Line(left, "tab:orange", 1.0),))

    def map_position(self) -> torch.Tensor:
        """The load, (W, 3) [m]."""
        return self.views.body_q[:, self.crane.load, :3]
