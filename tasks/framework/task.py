"""The base class of every task: the loop of one control step, episodes, and what is known about them.

A task author writes ``build``, ``apply``, ``observations``, ``rewards``, ``terminations`` and ``reset``; all but
``build`` work in torch on the device, for all worlds at once. None of them may read a tensor on the host
(``.item()``, ``.any()`` in an ``if``, a boolean mask as an index), for which the device would wait: ``torch.where``.
"""

from __future__ import annotations

import contextlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, ClassVar, Generic, NoReturn, TypeAlias, TypeVar

import torch

import simwarp as sw
from simwarp.core.interop import shared_stream
from simwarp.core.object_repr import Names, Readable, Row, array_text, plural

from ..randomisation.randomisation_config import Driver
from ..randomisation.randomising import randomiser_of
from ..randomisation.randomness import WorldRandom
from ..randomisation.sensing import Sensors
from .action_path import ActionPath
from .agents import Agents, lead_of
from .argument_checks import check_room, checked_level, whole
from .capture import StepCapture, recorder_of
from .config import TaskConfig, obs_of
from .contract import Contract, bad_value
from .control_step_kernels import Clocks, Recording, begin_episodes, count_step
from .drawing import Drawing
from .errors import InputError, TaskError
from .escapes import ESCAPES, raise_named
from .finite_observations import FiniteObservations
from .guard import Guard
from .interface_checks import check_action, check_names, check_physics_flag, check_reasons
from .joint_rows import JointRows
from .mirror import Mirror
from .model_group import ModelGroup
from .named_contacts import ContactTracker, NamedContacts, SoilForces
from .recorded_launches import WorldLaunch, filled, launch_over
from .rewards_and_ends import RewardsAndEnds
from .saved_task import copy_task_worlds, load_task_state, task_state
from .statistics import EpisodeStatistics, EpisodeSummary
from .step_result import StepResult
from .task_simulation import Attachments, PhysicsViews, physics_of
from .user_command import Command

ConfigT = TypeVar("ConfigT", bound=TaskConfig)

Groups: TypeAlias = dict[str, torch.Tensor]

TIME_LIMIT = "time_limit"
"""End reason of an episode that reached `max_episode_steps`."""
NON_FINITE = "non_finite"
"""End reason of an episode whose world became NaN or infinite."""


class Task(Readable, ABC, Generic[ConfigT]):
    """A batch of worlds with actions, observations, rewards and episodes.

    Where ``agents`` N is more than 1, what is (W, ...) below is (W, N, ...): actions, observations, reward terms,
    reasons to end and metrics. Masks and clocks are of worlds. An agent that is done asks for ``resting_action`` until
    all of its world are, and the world begins anew. Draws of one episode differ by column: take N of them.

    Args:
        config: the task's configuration.
        num_worlds: number of worlds W.
        device: canonical device name (:func:`~simwarp.tasks.make` resolves it).
        seed: seed of all randomness.
        first_world: global index of world 0, where several processes share one batch.
    """

    name: ClassVar[str] = ""
    """Set by ``@register``; until then that of the class."""
    task_file: ClassVar[str] = ""
    """Absolute ``path/to/file.py:TaskClass`` of a task that is not installed; set when it is loaded."""
    summary: ClassVar[str] = ""
    """One line for ``simwarp list``."""
    instruction: ClassVar[str] = ""
    """What is to be done, as a sentence to whoever does it, for datasets of policies that read; else ``summary``."""
    listed: ClassVar[bool] = True
    """False: ``simwarp list`` leaves the task out, as one for tests."""
    config_type: ClassVar[type[TaskConfig]] = TaskConfig
    """The frozen dataclass of this task's configuration."""
    action_size: int = 1
    """Number of action components A, of each agent."""
    agents: int = 1
    """Number of agents N in each world."""
    resting_action: float | Sequence[float] = 0.0
    """What an agent that is done before others of its world asks for, such as to brake: for all components or each."""
    physics: ClassVar[bool] = True
    """False for a task without a simulation; then ``build`` is not called."""
    fused_physics: ClassVar[bool] = False
    """True: kernels of `physics_launches` stand for ``apply``, ``after_physics`` and the action's rate limit."""
    watches_physics: ClassVar[bool] = False
    """True: ``after_physics`` is called after each physics step. True by itself in a class that writes it."""
    per_world: ClassVar[tuple[str, ...]] = ()
    """Model parameters that the task itself writes, world by world; those of ``randomise`` need no mention."""
    state_buffers: ClassVar[Mapping[str, str]] = {}
    """Tensors of the task's own that a checkpoint keeps: name in the file -> attribute."""
    success_reasons: ClassVar[frozenset[str]] = frozenset({TIME_LIMIT})
    """End reasons that count as success, unless ``metrics`` has a ``success``."""
    training: ClassVar[Mapping[str, Any]] = {}
    """Defaults of ``simwarp train`` for this task, such as ``{"iterations": 80, "ppo.gamma": 0.98}``."""
    training_by_obs: ClassVar[Mapping[str, Mapping[str, Any]]] = {}
    """Further defaults by the value of the configuration's field ``obs``, if there is one (``simwarp train --obs``)."""
    training_by_variant: ClassVar[Mapping[str, Mapping[str, Any]]] = {}
    """Further defaults by the configuration's field ``variant``, with the observations that the variant has."""
    distilling: ClassVar[Mapping[str, Any]] = {}
    """Further defaults of ``simwarp distill``, such as ``{"iterations": 40}``."""
    trained_in: ClassVar[Mapping[str, Any]] = {}
    """Fields of the configuration with which ``simwarp train`` begins in place of their defaults."""
    distilled_in: ClassVar[Mapping[str, Any]] = {}
    """Those with which ``simwarp distill`` begins, such as ``{"tracks": 16}``."""

    further_elements: Callable[[sw.Model], Sequence[Any]] | None = None
    """Returns force elements that come after those of ``attach``; given to :func:`~simwarp.tasks.make`."""
    rows_in_batch: JointRows | None = None
    """Tensors of a mixed batch in which this task has its rows; given to it before it is built."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "name" not in vars(cls):
            cls.name = cls.__name__
        cls.watches_physics = cls.watches_physics or cls.after_physics is not Task.after_physics
        check_physics_flag(cls, Task)

    def __init__(
        self, config: ConfigT, num_worlds: int, *, device: str = "cpu", seed: int = 0, first_world: int = 0
    ) -> None:
        num_worlds = whole("num_worlds", num_worlds, 1, 2**31 - 1)
        seed, first_world = whole("seed", seed, -(2**63), 2**63 - 1), whole("first_world", first_world, 0, 2**53)
        self.config: ConfigT = config
        self.num_worlds = num_worlds
        self.device = torch.device(device)
        self.keep_final_observations = True
        self.capture = True
        """Capture control steps into a CUDA graph, where there is a CUDA device."""
        self._captured = StepCapture(self, recorder_of(self.device))
        self._sensors_in_step = True
        """Whether sensors are launched only where they are due: a captured step is for one of the two."""
        self._iteration = 0
        self._climbing = False
        self._contacts = ContactTracker()
        self.first_world = first_world
        self.contract = Contract(self)
        """Calls the methods that return something, and holds the results to their form."""
        self.before_reset: Callable[[], None] | None = None
        """Called in every control step once it is judged, while the worlds that ended still are where they ended."""
        with self._acting():
            self._allocate(seed, first_world)
            self.simulation, self._views, self.builder = physics_of(self, device)
            self._randomiser = randomiser_of(config.uncertainty.randomise, self.simulation, f"task '{self.name}'")
            self.guard = Guard(self, config.guard_steps) if self.simulation and config.guard_steps else None
            """Recorder of the last steps, for the dump of a world whose physics breaks down."""
            self._record()
            self.setup()
            self._record_physics()
            self._probe()
            self.restart(seed=seed)

    # ---- what a task author writes -----------------------------------------------------------------------------

    @classmethod
    def played_by(cls, config: ConfigT) -> str | None:
        """Return ``module:Class``, a subclass that plays this configuration; None: the class itself. Optional."""
        return None

    def build(self, builder: sw.ModelBuilder) -> sw.ModelBuilder | None:
        """Add the bodies and joints of one world to ``builder``, or return a builder of your own."""
        raise NotImplementedError(f"{type(self).__name__} has no build(builder); set physics = False if it needs none")

    @property
    def own_parameters(self) -> frozenset[str]:
        """Return the model parameters that the task writes world by world; those of `per_world` by default."""
        return frozenset(self.per_world)

    def solver_options(self) -> sw.SolverOptions | None:
        """Return the numbers of the solver; None takes its defaults."""
        return None

    def flex_options(self) -> sw.flex.Options | None:
        """Return the numbers of rods and other flexible parts; None takes their defaults."""
        return None

    def attach(self, model: sw.Model) -> Attachments:
        """Return the elements of every physics step: force elements such as a vehicle, sensors. Optional."""
        return Attachments()

    def setup(self) -> None:
        """Allocate the task's own buffers, once, after the simulation exists. Optional."""

    def begin_step(self) -> None:
        """Called before the action of each control step: store what a difference needs. Optional."""

    @abstractmethod
    def apply(self, action: torch.Tensor) -> None:
        """Turn ``action`` ((W, A) float32, each in [-1, 1]) into controls; they hold until written again.

        Called once per control step, and once per physics step where ``action_rise_time`` limits the action's rate.
        """

    def after_physics(self) -> None:
        """Called after each physics step, for events that must not be missed between control steps. Optional."""

    def physics_launches(self) -> Sequence[WorldLaunch]:
        """Return launches before each physics step that stand for ``apply``, ``after_physics`` and the action's rate
        limit, of a class with ``fused_physics = True``. The methods stay: a subclass with False is stepped by them.
        """
        raise NotImplementedError(f"{type(self).__name__} has fused_physics = True and no physics_launches()")

    def finish_physics(self) -> None:
        """Called after the last physics step of a control step. Optional."""

    @abstractmethod
    def observations(self) -> dict[str, torch.Tensor]:
        """Return the named observation groups, each (W, ...), of any dtype but float64; ``policy`` is the usual one.

        Called before and after the reset of each step: it must not change state.
        """

    def privileged(self) -> torch.Tensor | None:
        """Return (W, N) float32 of exact state that only the critic may see in training; None if there is none.

        Asked for by ``--network.critic privileged``, after the reset of each step: it must not change state. Optional.
        """
        return None

    def observations_of(self, obs: str | None) -> dict[str, torch.Tensor] | None:
        """Return the groups (W, ...) that a policy of other observations would see, exact; None where there are none.

        Asked for by ``simwarp distill``, whose teacher sees them. Optional; it must not change state.

        Args:
            obs: name of the observations, a value of the configuration's field ``obs``.
        """
        return None

    @abstractmethod
    def rewards(self) -> dict[str, torch.Tensor]:
        """Return the named, weighted reward terms of this step, each (W,) float32; the reward is their plain sum."""

    @abstractmethod
    def terminations(self) -> dict[str, torch.Tensor]:
        """Return the named reasons to end now, each (W,) bool: failures and goals. The first one named counts."""

    @abstractmethod
    def reset(self, world_mask: torch.Tensor) -> None:
        """Start a new episode in the worlds of ``world_mask`` ((W,) bool) and change nothing in the others.

        The simulation is in its initial state there already, and ``self.action`` zero; controls are as they were. Draw
        from ``self.random``.
        """

    def truncations(self) -> dict[str, torch.Tensor]:
        """Return further named reasons to cut an episode off, beside the step limit, each (W,) bool."""
        return {}

    def metrics(self) -> dict[str, torch.Tensor]:
        """Return named (W,) values that an evaluation reports of an episode's end; ``success`` (bool) decides it."""
        return {}

    def drawing(self) -> Drawing:
        """Return lines of pictures and maps beside the bodies, such as paths and goals; by default none."""
        return Drawing()

    def map_position(self) -> torch.Tensor | None:
        """Return the agent's position, (W, 3) [m], for paths on a map: by default body 0's; None if it has none."""
        return None if self._views is None else self.views.body_q[:, 0, :3]

    def visuals(self, visuals: sw.sensors.Visuals) -> None:
        """Add to what rendered pictures show, or paint it; the shapes of ``build`` are there already. Optional."""

    def scene(self) -> sw.sensors.Scene | None:
        """Return the scene of rendered pictures: bodies, as balls where none has a shape; None without. Optional."""
        if self.simulation is None or self.builder is None or not self.builder.bodies:
            return None
        visuals = sw.sensors.Visuals(self.builder)
        self.visuals(visuals)
        if all(instance.body < 0 for instance in visuals.instances):
            sw.viewer.add_bodies(visuals)
        sw.viewer.paint(visuals)
        return visuals.finalize(self.simulation.model)

    def shot(self) -> sw.viewer.Shot:
        """Return the view of the camera of ``simwarp play``; by default it follows body 0."""
        return sw.viewer.Shot()

    def lighting(self) -> sw.sensors.Lighting | None:
        """Return the lights that cameras and pictures see by; None: sun and sky."""
        return None

    def commands(self) -> dict[str, Command]:
        """Return what a person may ask for while looking on, such as a speed: name -> `Command`. Optional."""
        return {}

    @property
    def observation_names(self) -> Mapping[str, Sequence[str]]:
        """Names of the components of observation groups that are rows of numbers: group -> names, in their order."""
        return {}

    @property
    def observation_kinds(self) -> Mapping[str, str]:
        """Kinds of observation groups, where the shape does not say it: group -> ``vector``, ``image``, ``points`` or
        ``sequence``. A group (N, 3) or (N, 4) is a cloud of points, any other (N, C) a sequence.
        """
        return {}

    @property
    def action_names(self) -> Sequence[str]:
        """Names of the components of an action, in their order; empty where it has none."""
        return ()

    @property
    def action_joints(self) -> Sequence[str]:
        """Names of the joints, of one coordinate each, that the components of an action move, in their order."""
        return ()

    @property
    def action_scale(self) -> Sequence[float]:
        """What a full action is, component by component [N·m, rad, m, as the task says]; empty where it has no unit."""
        return ()

    @property
    def default_positions(self) -> Sequence[float]:
        """Coordinates of ``action_joints`` at rest, from which actions count [rad or m]; empty: as they are built."""
        return ()

    def mirror(self) -> Mirror | None:
        """Return what left-right reflection makes of observations and actions; None where there is no such symmetry.

        Asked for by ``--ppo.symmetry``. Optional.
        """
        return None

    def on_iteration(self, iteration: int) -> Mapping[str, torch.Tensor] | None:
        """Hook of a curriculum, at the start of a training iteration: call ``super()``, return (W,) to log means of."""
        self.iteration = iteration
        curriculum = self.config.curriculum
        if curriculum.driver is Driver.ITERATION:
            self.level.fill_(curriculum.at_iteration(iteration))
        elif curriculum.driver is Driver.PROGRESS and not self._climbing:
            self._climb(True)
            self.level.zero_()
        return None if curriculum.driver is Driver.NONE else {"level": self.level}

    def extra_state(self) -> dict[str, torch.Tensor]:
        """Return the task's own state that a checkpoint must keep: name -> (...); by default `state_buffers`."""
        return {name: getattr(self, attribute) for name, attribute in self.state_buffers.items()}

    def load_extra_state(self, state: Mapping[str, torch.Tensor]) -> None:
        """Load what :meth:`extra_state` returned, name -> (...); write into existing buffers."""
        for name, attribute in self.state_buffers.items():
            getattr(self, attribute).copy_(state[name])

    def step_limit(self) -> torch.Tensor:
        """Return (W,) int64: control steps after which the running episodes are over at the latest.

        A task whose :meth:`truncations` come sooner says so here: training spreads the first time-outs over them.
        """
        return torch.full((self.num_worlds,), self.config.max_episode_steps, device=self.device)

    def contacts(self, *names: str, threshold: float = 1.0, soil: SoilForces | None = None) -> NamedContacts:
        """Return the contacts of shapes or bodies, kept up to date from now on: for ``setup``.

        Args:
            names: of shapes, or of bodies.
            threshold: of the force from which on a part touches [N].
            soil: whose forces on the parts are contacts too; None: there is none.

        Raises:
            InputError: a name is unknown, or the task has no physics.
        """
        return self._contacts.add(self, names, threshold, soil)

    # ---- what runners and adapters call ------------------------------------------------------------------------

    def restart(self, seed: int | None = None) -> dict[str, torch.Tensor]:
        """Begin a new episode in every world and return the observations, group name -> (W, ...).

        With ``seed`` the randomness starts over: the same seed gives the same episodes again.
        """
        with self._acting():
            if seed is not None:
                if self.guard is not None:  # while the seed is still that of the break
                    self.guard.notice()
                self.random.reseed(seed)
                self.episode_index.fill_(-1)
            self._outcome.ended.fill_(True)
            self._reset_worlds(self._outcome.ended, every=True)
            self._statistics.running.zero_()
            return self._observe_begun(self._every_world)

    def begin_episodes(self, world_mask: torch.Tensor) -> dict[str, torch.Tensor]:
        """Begin new episodes in the worlds of a mask ((W,) bool), as if theirs had ended; return the observations."""
        world_mask = world_mask.to(self.device)
        with self._acting():
            self._reset_worlds(world_mask)
            return self._observe_begun(world_mask)

    def observe(self) -> dict[str, torch.Tensor]:
        """Return the observations as a policy gets them, group name -> (W, ...): late and noisy where configured."""
        with self._acting():
            return self._sensors.sense(self.contract.observations())

    def observe_privileged(self) -> torch.Tensor | None:
        """Return the privileged observations of a critic, (W, N) float32; None where the task has none."""
        with self._acting():
            return self.contract.privileged()

    def observe_as(self, obs: str | None) -> dict[str, torch.Tensor]:
        """Return what a policy of other observations would see now, group name -> (W, ...), exact and at once.

        Args:
            obs: name of the observations; None: the task's own.

        Raises:
            InputError: the task does not offer them in this configuration.
        """
        own = obs_of(self.config)
        with self._acting():
            groups = self.contract.observations() if obs in (None, own) else self.contract.observations_of(obs)
        if groups is None:
            besides = "" if own is None else f" with '{own}' observations"
            raise InputError(
                f"task '{self.name}'{besides} does not offer '{obs}' ones beside them: "
                f"its observations_of('{obs}') returns None"
            )
        return groups

    def step(self, action: torch.Tensor) -> StepResult:
        """Advance every world by one control step; ``action`` is (W, A), clipped to [-1, 1]; (W, N, A) of agents.

        1. ``_delay_action``: agents that are done rest, and what is asked for passes its delay.
        2. ``_advance_physics``: ``begin_step``, then the physics steps, each with ``apply`` or kernels in its place.
        3. ``_judge_step``: ``rewards``, ``terminations``, ``truncations``, ``metrics``; observations before the reset.
        4. ``_reset_ended``: ``reset`` of the worlds whose episode is over.
        5. ``_observe_begun``: ``observations`` of the state after that.

        Raises:
            TaskError: the action has the wrong shape or dtype.
        """
        check_action(self, action)
        self.contract.step += 1
        with self._acting():
            self._path.asked.copy_(action.view_as(self._path.asked))
            if self.guard is not None:
                self.guard.before_step()
            metrics, final, groups = self._run_phases(
                self._delay_action, self._advance_physics, self._judge_step, self._reset_ended, self._observe_begun
            )
            verdict = self._outcome.hand_out()
            acting = self._agents.acting.clone() if self._agents.several else None
        return StepResult(
            **vars(verdict), observations=groups, metrics=metrics, final_observations=final, acting=acting
        )

    def advance(self, request: torch.Tensor) -> None:
        """Take the physics through one control step towards ``request`` (W, A): no rewards, no reset.

        What :meth:`step` does after the action's delay, and what a replay repeats.
        """
        with self._acting():
            self._path.request.copy_(request.view_as(self._path.request))
            self._advance_physics()

    def look_ahead(self, action: torch.Tensor) -> None:
        """Take the physics through one control step as :meth:`step` does, the action's delay included: no rewards, no
        reset. For plans; ``action`` is (W, A), clipped to [-1, 1].
        """
        with self._acting():
            self._path.asked.copy_(action.view_as(self._path.asked))
            self._delay_action()
            self._advance_physics()

    def set_level(self, level: float | torch.Tensor) -> None:
        """Hold the curriculum's level from here on: episodes that begin draw by it, and no success moves it.

        Args:
            level: dimensionless, in [0, 1], of all worlds; or (W,) of each.

        Raises:
            InputError: it is none.
        """
        values = checked_level("level", level, self.num_worlds)
        self._climb(False)
        self.level.copy_(values)

    def state_dict(self) -> dict[str, Any]:
        """Return everything that a later :meth:`load_state_dict` needs to go on exactly from here."""
        return task_state(self)

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Load what :meth:`state_dict` returned, for the same configuration and number of worlds.

        Raises:
            InputError: it is of another number of worlds, another simulation, or an older version of simwarp.
        """
        load_task_state(self, state)

    def copy_worlds(self, source: Any, targets: Any = None, *, of: Task[Any] | None = None) -> None:
        """Make worlds copies of others: their physics, parameters included, episodes, delays and own state.

        They then go on alike under the same actions, bit by bit: they draw what their source would, until the task is
        restarted with a seed. Noise of the simulation's sensors alone is each world's own.

        Args:
            source: the world to be copied; or one for each target.
            targets: worlds that become copies, as indices or as a (W,) bool mask; None: all.
            of: task of the same class, configuration and seed that has the source; None: this one.

        Raises:
            InputError: the task has no physics, or `of` is another one.
            ModelError: there are no such worlds; see :meth:`Simulation.copy_worlds <simwarp.Simulation.copy_worlds>`.
        """
        copy_task_worlds(self, source, targets, of)

    def __reduce__(self) -> NoReturn:
        raise TypeError(
            f"task '{self.name}' cannot be pickled or copied: it refers to memory of a device; make it again with "
            f"make('{self.name}', {self.num_worlds}, config=task.config) and bring its state over with state_dict() "
            "and load_state_dict()"
        )

    def drain_statistics(self) -> EpisodeSummary:
        """Read and clear the statistics of the episodes that ended. This waits for the device.

        Raises:
            TaskStepError: a reward term or an observation held NaN or infinity while the physics was sound.
        """
        summary = self._statistics.drain()
        kept = None if self.guard is None else self.guard.look()
        if summary.first_bad is not None:
            raise bad_value(self, summary, kept)
        return summary

    def check_values(self) -> None:
        """Raise what :meth:`drain_statistics` raises, if there is a reason; this reads one number of the device."""
        if self._statistics.any_bad():
            self.drain_statistics()

    @property
    def model_groups(self) -> tuple[ModelGroup, ...]:
        """Models and the worlds that have them: of a mixed batch several, else this task and all of its worlds."""
        return (ModelGroup("", self, slice(0, self.num_worlds)),)

    @property
    def reward_terms(self) -> list[str]:
        """Names of the reward terms."""
        return self._statistics.terms

    @property
    def weighted_terms(self) -> list[str]:
        """Names of the reward terms, each with its weight where the configuration has one, as ``turn 0.5``."""
        weights = self.config.reward_weights()
        return [f"{term} {weights[term]:g}" if term in weights else term for term in self.reward_terms]

    @property
    def end_reasons(self) -> list[str]:
        """Names of the reasons an episode ends for; ``StepResult.end_reason`` indexes them."""
        return self._statistics.reasons

    @property
    def iteration(self) -> int:
        """Training iteration, set by the trainer; for a curriculum."""
        self._captured.iteration_read = True
        return self._iteration

    @iteration.setter
    def iteration(self, value: int) -> None:
        self._iteration = value

    @property
    def not_captured(self) -> str:
        """Reason for which control steps are not captured into a CUDA graph; empty where they are, or will be."""
        return self._captured.reason if self.capture else "it is switched off"

    @property
    def views(self) -> PhysicsViews:
        """Torch views of the simulation's state and control.

        Raises:
            TaskError: the task has no physics.
        """
        if self._views is None:
            raise TaskError(f"task '{self.name}' has no physics")
        return self._views

    def _readable_title(self) -> str:
        return f" '{self.name}': {plural(self.num_worlds, 'world')} on {self.device}"

    def _readable_rows(self) -> dict[str, Row]:
        config = self.config
        groups = [
            f"{name} {(*lead_of(self), *shape)} {str(self.observation_dtypes[name]).rpartition('.')[2]}"
            for name, shape in self.observation_shapes.items()
        ]
        steps = config.decimation if self.simulation is not None else 1
        return {
            "action": f"{array_text(self.action)} in -1..1",
            "observations": ", ".join(groups),
            "rewards": Names(len(self.reward_terms), self.weighted_terms),
            "ends": Names(len(self.end_reasons), self.end_reasons),
            "time": f"{config.dt * steps:g} s a step ({plural(steps, 'physics step')} of {config.dt:g} s), "
            f"at most {plural(config.max_episode_steps, 'step')} an episode",
        }

    # ---- the loop ----------------------------------------------------------------------------------------------

    @contextlib.contextmanager
    def _acting(self) -> Iterator[None]:
        """Context of changes to the state: without gradients, Warp and torch on one stream, and ordinary tensors.

        Callers roll out under inference_mode; tensors made there could never be written in place afterwards.
        """
        with torch.inference_mode(False), torch.no_grad():
            apart = self.device.type != "cpu" and self.physics
            with shared_stream(str(self.device)) if apart else contextlib.nullcontext():
                try:
                    yield
                except ESCAPES as error:
                    raise_named(error)
                    raise

    def _allocate(self, seed: int, first_world: int) -> None:
        worlds, device = self.num_worlds, self.device
        words = 8 + 2 * self.action_size * self.agents  # of what follows, at least
        check_room(f"task '{self.name}': {worlds} worlds", (worlds, words), torch.float32, device, "take fewer worlds")
        self.episode_index = self._in_batch("episode_index", torch.zeros(worlds, dtype=torch.int64, device=device))
        """(W,) int64: number of the running episode of each world."""
        self.episode_steps = self._in_batch("episode_steps", torch.zeros(worlds, dtype=torch.int64, device=device))
        """(W,) int64: control steps since the last reset."""
        self.episode_clock = self._in_batch("episode_clock", torch.zeros(worlds, dtype=torch.int64, device=device))
        """(W,) int64: what the step limit looks at; a trainer may shift it to spread time-outs."""
        self._agents = Agents(self, device)
        self.action = self._in_batch("action", torch.zeros(*lead_of(self), self.action_size, device=device))
        """(W, A) float32: the action in force, clipped and rate-limited."""
        self._actions = self.action.view(worlds, -1)
        self._every_world = torch.ones(worlds, dtype=torch.bool, device=device)
        self.level = self._in_batch("level", torch.ones(worlds, device=device))
        """(W,) float32: the curriculum's level in [0, 1]; 1 outside training."""
        self.drawn_level = torch.ones(worlds, device=device)
        """(W,) float32: the level as the running episodes began, by which they draw; `level` may have moved since."""
        self._path = ActionPath(self._actions, self.config, self.name, in_physics=self.physics, agents=self.agents)
        self._agents.bind(self._path.asked)
        self.random = WorldRandom(seed, self.episode_index, self.episode_steps, first_world)
        self._clocks = filled(
            Clocks, episode=self.episode_index, steps=self.episode_steps, limit=self.episode_clock,
            drawn_level=self.drawn_level,
        )  # fmt: skip

    def _in_batch(self, name: str, made: torch.Tensor) -> torch.Tensor:
        """Return a tensor (W, ...) that was made, or where this task is one of several, its rows of theirs."""
        return made if self.rows_in_batch is None else self.rows_in_batch.like(name, made)

    def _climb(self, climbing: bool) -> None:
        self._climbing = climbing
        self._outcome.climb(climbing)

    def _record_physics(self) -> None:
        """Record what is launched before each physics step; again, where the memory of it is another one."""
        self._physics = self.simulation.program(self.physics_launches()) if self.fused_physics else None

    def _record(self) -> None:
        """Record the launches that bracket the author's methods, but for the verdict, which hangs on their names."""
        views, nothing = self._views, torch.zeros(0, dtype=torch.int32, device=self.device)
        self._status = nothing if views is None else views.world_status
        no_joints = torch.zeros(self.num_worlds, 0, device=self.device)
        joints = (no_joints, no_joints) if views is None else (views.joint_q, views.joint_qd)
        self._recording = Recording() if self.guard is None else self.guard.recording
        counted = [self._status, self.level, self._path.request, *joints, self._clocks, self._recording]
        self._count = launch_over(self, count_step, *counted)
        self._begin = launch_over(self, begin_episodes, self._every_world, self.level, self._clocks, self._actions)

    def _probe(self) -> None:
        """Call the author's methods once to learn their names and hold them to the contract."""
        self._reset_worlds(self._every_world, every=True)
        self.begin_step()
        self.apply(self.action)
        contract = self.contract
        groups = contract.observations()
        self._sensors = Sensors(self.config.uncertainty.sensing, groups, self.random, self.agents)
        self.observation_shapes = {name: tuple(group.shape[len(lead_of(self)) :]) for name, group in groups.items()}
        self.observation_dtypes = {name: group.dtype for name, group in groups.items()}
        check_names(self)
        terms, terminations, truncations = list(contract.rewards()), contract.terminations(), contract.truncations()
        metrics, reasons = contract.metrics(), [NON_FINITE, *terminations, *truncations, TIME_LIMIT]
        check_reasons(self, metrics, reasons)
        self._statistics = EpisodeStatistics(self._agents.done.numel(), terms, reasons, list(groups), self.device)
        wins = [reason in self.success_reasons for reason in reasons]
        self._outcome = RewardsAndEnds(
            self.config, len(terminations), len(truncations), wins, "success" in metrics, self._status, self._clocks,
            self.level, self._statistics, self._agents, self._recording,
        )  # fmt: skip
        self._finite = FiniteObservations(groups, self._statistics, self._clocks, self._recording)
        if self.guard is not None:
            self.guard.values = self._statistics.values

    def _run_phases(self, *phases: Callable[[], Any]) -> tuple[Groups, Groups | None, Groups]:
        """Run the phases of a control step, as one captured graph where there are graphs; two around `before_reset`.

        Returns:
            Metrics, observations before the reset where they are kept, observations after it.
        """
        if self.simulation is not None:
            self._sensors_in_step = self.simulation.read_interval.at_start
        run = self._captured.run
        if self.before_reset is None:
            results, rewritten = run("step", lambda: [phase() for phase in phases])
        else:
            judged, rewritten = run("until the reset", lambda: [phase() for phase in phases[:3]])
            self.before_reset()
            begun, _ = run("from the reset on", lambda: [phase() for phase in phases[3:]])
            results = judged + begun
        _, _, (metrics, final), _, groups = results
        if rewritten:
            metrics = {name: value.clone() for name, value in metrics.items()}
        return metrics, final, groups

    def _delay_action(self) -> None:
        """Write what agents that are done do into the actions asked for, and delay these."""
        self._agents.rest()
        self._path.delay()

    def _advance_physics(self) -> None:
        """Advance the physics by a control step towards the requested action, and count the step."""
        if self._randomiser is not None:
            self._randomiser.begin_step(self.random, self._every_world, self.level)
        self.begin_step()
        decimation = self.config.decimation if self.simulation is not None else 0
        if self._physics is not None:
            self._physics.run(decimation)
        else:
            self._step_by_methods(decimation)
        self.finish_physics()
        self._contacts.update()
        self._count.launch()

    def _step_by_methods(self, decimation: int) -> None:
        """Take the physics through its steps, between which an author's methods act."""
        gradual = self._path.limited and decimation > 0
        if not gradual:
            self._path.move()
            self.apply(self.action)
        if not gradual and not self.watches_physics:
            if decimation > 0:
                self.simulation.advance(decimation)
            return
        for _ in range(decimation):
            if gradual:
                self._path.move()
                self.apply(self.action)
            self.simulation.step()
            self.after_physics()

    def _judge_step(self) -> tuple[Groups, Groups | None]:
        """Judge the state reached; return metrics, and observations before the reset where they are kept."""
        contract = self.contract
        rewards, flags = contract.rewards(), [*contract.terminations().values(), *contract.truncations().values()]
        metrics = {name: value.clone() for name, value in contract.metrics().items()}
        self._outcome.judge(rewards.values(), flags, metrics.get("success"))
        if self._sensors.late:
            self._sensors.push(contract.observations())
        if not self.keep_final_observations:
            return metrics, None
        return metrics, self._finite.kept(self.observe(), self._outcome.broken)

    def _reset_ended(self) -> None:
        """Begin an episode in the worlds whose episode is over."""
        self._reset_worlds(self._outcome.ended)

    def _observe_begun(self, mask: torch.Tensor | None = None) -> Groups:
        """Observe, where the worlds of a mask (W,) bool have just begun an episode; None: those that ended."""
        groups = self.contract.observations()
        self._finite.count(groups)
        self._sensors.begin(self._outcome.ended if mask is None else mask, groups)
        return self._sensors.sense(groups)

    def _reset_worlds(self, mask: torch.Tensor, every: bool = False) -> None:
        """Begin an episode in the worlds of a mask (W,) bool; ``every``: it is known that these are all."""
        self._begin.on(mask)
        self._agents.begin(mask)
        self._path.begin(mask, self.random)
        self._contacts.begin(mask)
        if self.simulation is not None:
            self.simulation.reset(mask, sensors=False)
        if self._randomiser is not None:
            self._randomiser.begin_episodes(self.random, mask, self.drawn_level)
        self.reset(mask)
        if self.simulation is not None:
            self.simulation.begin_sensors(None if every else mask)
