"""Configuration of a training run, and its translation to what rsl-rl reads."""

from __future__ import annotations

import dataclasses
import enum
import math
import os
from collections.abc import Mapping
from typing import Annotated, Any, TypeAlias

import tyro

from simwarp.core.constraints import Count, Fraction, Ge, Gt, Le, MaxLen, MinLen, NotNegative, Positive, Whole
from simwarp.core.file_keys import with_current_threads
from simwarp.core.threads import MOST_THREADS
from simwarp.tasks import InputError, Task, TaskConfig, config_from_plain, replace_fields, require
from simwarp.tasks.framework.config import obs_of
from simwarp.tasks.framework.config_values import Settings
from simwarp.tasks.framework.mirror import Mirror
from simwarp.tasks.framework.observation_kinds import ObservationKind
from simwarp.tasks.framework.registry import task_class_of
from simwarp.tasks.framework.variants import variant_of

CRITIC = "critic"
"""Observation group of a privileged critic."""
_MOST_LAYERS, _MOST_UNITS, _MOST_EPOCHS = 64, 16_384, 10_000
_MOST_COUNTED = 2**31 - 1
_MOST_SHIFT = 64
"""Longest axis of an array."""
Axis: TypeAlias = Annotated[int, Ge(1), Le(_MOST_COUNTED)]
Units: TypeAlias = Annotated[int, Ge(1), Le(_MOST_UNITS)]


class Activation(enum.Enum):
    """Non-linearity between layers."""

    ELU = "elu"
    RELU = "relu"
    TANH = "tanh"


class Schedule(enum.Enum):
    """How the learning rate moves: by the KL divergence of each update, not at all, or down to 0 at the end."""

    ADAPTIVE = "adaptive"
    FIXED = "fixed"
    LINEAR = "linear"
    COSINE = "cosine"


class Objective(enum.Enum):
    """What keeps a new policy near the old one: a clipped probability ratio, or a penalty on the KL divergence."""

    CLIP = "clip"
    KL_PENALTY = "kl-penalty"


class Symmetry(enum.Enum):
    """Use of a task's mirror image: learn from mirrored samples too, or punish acting otherwise on what is mirrored."""

    NONE = "none"
    AUGMENT = "augment"
    LOSS = "loss"


class NetworkKind(enum.Enum):
    """Networks by name; see ``simwarp.train.networks.networks``."""

    MLP = "mlp"
    THESIS_MLP = "thesis-mlp"
    RECURRENT = "recurrent"
    MULTI_INPUT = "multi-input"
    NATURE_CNN = "nature-cnn"
    EARLY_FUSION = "early-fusion"
    LATE_FUSION = "late-fusion"


class InitialWeights(enum.Enum):
    """How weights are drawn: as each layer has it, or all of N(0, 0.1), with biases of 0.1."""

    LAYERS = "layers"
    NORMAL = "normal"


class CriticSees(enum.Enum):
    """What the critic looks at."""

    SAME = "same"
    PRIVILEGED = "privileged"


class Cell(enum.Enum):
    """Memory cell of a recurrent network."""

    GRU = "gru"
    LSTM = "lstm"


class LoggerKind(enum.Enum):
    """Where scalars go beside ``progress.csv``."""

    TENSORBOARD = "tensorboard"
    CSV = "csv"
    WANDB = "wandb"


class Precision(enum.Enum):
    """Numbers that convolutions are computed with while a network learns."""

    FLOAT32 = "float32"
    BFLOAT16 = "bfloat16"


@dataclasses.dataclass(frozen=True)
class AugmentationConfig(Settings):
    """Bounds of random changes of uint8 images while a network learns; see ``simwarp.train.networks.augmentation``."""

    shift: Annotated[int, Ge(0), Le(_MOST_SHIFT)] = 0
    """Move images by up to as many pixels each way, edges repeated; DrQ has 4."""
    brightness: Fraction = 0.0
    """Make images brighter or darker by up to this, of the whole range."""
    contrast: Fraction = 0.0
    """Stretch or shrink differences from an image's mean by up to this factor less 1."""

    @property
    def wanted(self) -> bool:
        """True if anything changes."""
        return bool(self.shift or self.brightness or self.contrast)


@dataclasses.dataclass(frozen=True)
class NetworkConfig(Settings):
    """Actor and critic: two networks, of the same kind unless the critic is privileged."""

    kind: NetworkKind = NetworkKind.MLP
    """mlp: perceptron with the layers of `hidden`; thesis-mlp: three layers sized by inputs and outputs; recurrent: a
    memory cell before the perceptron; multi-input: an encoder for each image, cloud of points and sequence, and a
    perceptron over them and all vectors; nature-cnn: images alone; early-fusion, late-fusion: images and vectors."""
    class_: Annotated[str | None, tyro.conf.arg(name="class")] = None
    """A network of your own in place of `kind`, module:Class or path/to/file.py:Class: a torch module that is made with
    the shapes of the observation groups by name and the number of outputs, and called with the groups by name."""
    hidden: Annotated[tuple[Units, ...], MinLen(1), MaxLen(_MOST_LAYERS)] = (64, 64)
    """Units of each hidden layer of mlp, recurrent, multi-input and a privileged critic; the other kinds have rules of
    their own."""
    features: Units = 128
    """Numbers that each encoder of multi-input leaves."""
    activation: Activation = Activation.ELU
    """Non-linearity between layers."""
    normalise: bool = True
    """Normalise observations by their running mean and deviation."""
    init_std: Positive = 1.0
    """Standard deviation of the actions at the start."""
    init_mean: tuple[float, ...] = ()
    """Mean action at the start, whatever is observed: one number for all, or one for each. The weights of the actor's
    last layer then begin at a hundredth. Empty: what the layers as drawn give, which the seed decides."""
    init_weights: InitialWeights = InitialWeights.LAYERS
    """layers: weights as each layer draws them; normal: those of all layers from N(0, 0.1), with biases of 0.1."""
    tanh_output: bool = False
    """Bound the mean action to (-1, 1) by a tanh."""
    symmetric: bool = False
    """Act mirrored on what is mirrored, by construction: actor and critic answer with the mean over a state and its
    mirror image. For mlp and thesis-mlp, and tasks that have a `mirror()`."""
    cell: Cell = Cell.GRU
    """Memory cell of recurrent."""
    memory: Units = 64
    """Units of the memory cell of recurrent."""
    critic: CriticSees = CriticSees.SAME
    """same: what the actor sees, with a network of its kind; privileged: exact state that the task keeps from the
    actor, with a perceptron. Only training needs a critic."""
    precision: Precision = Precision.FLOAT32
    """Numbers of convolutions in training; the weights stay float32, and a finished policy acts in float32. bfloat16 is
    faster where the processor has instructions for it (AVX-512 BF16, AMX)."""

    def __post_init__(self) -> None:
        """Hold the fields to their types, and the file of a network to its folder: a run is resumed anywhere."""
        super().__post_init__()
        path, colon, name = (self.class_ or "").rpartition(":")
        if path.endswith(".py"):
            object.__setattr__(self, "class_", f"{os.path.abspath(path)}{colon}{name}")

    @property
    def recurrent(self) -> bool:
        """True if the network remembers."""
        return self.kind is NetworkKind.RECURRENT and self.class_ is None


@dataclasses.dataclass(frozen=True)
class PPOConfig(Settings):
    """Proximal policy optimisation (Schulman et al. 2017)."""

    objective: Objective = Objective.CLIP
    """clip: bound the probability ratio; kl-penalty: penalise the KL divergence, with a weight that adapts."""
    learning_rate: Positive = 1e-3
    """Step size of Adam at the start."""
    schedule: Schedule = Schedule.ADAPTIVE
    """How the learning rate moves; the KL penalty has a rule of its own. linear and cosine end at 0 with the last
    iteration: a run that is resumed with more of them begins higher again."""
    desired_kl: Positive = 0.01
    """KL divergence per update that the adaptive schedule, or the KL penalty, aims at."""
    kl_beta: Positive = 1.0
    """Weight of the KL penalty at the start; it adapts between 1/35 and 35."""
    kl_hinge: NotNegative = 50.0
    """Weight of the squared KL divergence beyond twice the desired one, under the KL penalty."""
    epochs: Annotated[int, Ge(1), Le(_MOST_EPOCHS)] = 5
    """Passes over each batch."""
    mini_batches: Count = 4
    """Parts of a batch, one optimiser step each."""
    clip: Positive = 0.2
    """Bound of the probability ratio's change."""
    gamma: Annotated[float, Gt(0.0), Le(1.0)] = 0.99
    """Discount per control step."""
    lam: Fraction = 0.95
    """Trace decay of the advantage estimate."""
    value_loss: NotNegative = 1.0
    """Weight of the value loss."""
    clip_value_loss: bool = False
    """Let values move by at most `clip` per update. It stalls a critic whose returns are far larger than 1."""
    reward_scale: Positive = 1.0
    """Factor of the rewards that are learnt from; what is reported is without it. Values are learnt faster where
    returns are of the order of ten."""
    entropy: NotNegative = 0.0
    """Weight of the entropy bonus."""
    max_grad_norm: Positive = 1.0
    """Bound of the gradient's norm."""
    symmetry: Symmetry = Symmetry.NONE
    """augment: learn from the mirror image of each sample as well; loss: punish a policy that does not act mirrored on
    what is mirrored. For tasks that have a `mirror()`."""
    mirror_loss: NotNegative = 1.0
    """Weight of the loss of `symmetry loss`."""

    def scheduled_rate(self, done: float) -> float | None:
        """Return the learning rate where it follows the progress of the run; None where it does not.

        Args:
            done: share of the iterations that are over.
        """
        if self.schedule is Schedule.LINEAR:
            return self.learning_rate * (1.0 - done)
        if self.schedule is Schedule.COSINE:
            return self.learning_rate * 0.5 * (1.0 + math.cos(math.pi * done))
        return None


@dataclasses.dataclass(frozen=True)
class TrainConfig(Settings):
    """A training run."""

    num_envs: Axis = 256
    """Worlds stepped together, by each process where there are several."""
    device: str = "auto"
    """Where physics and networks run: cpu, cuda, cuda:N, or auto (the first GPU, else the CPU)."""
    seed: Whole = 0
    """Seed of worlds, networks and exploration."""
    iterations: Count = 100
    """Training iterations in total; a resumed run goes on up to this number."""
    minutes: Positive | None = None
    """Time that training may take by the clock [min], from its start or resume: the iteration in which it runs out is
    the last one, where `iterations` does not end it before."""
    steps_per_iteration: Axis = 32
    """Control steps of every world per iteration."""
    save_interval: Count = 25
    """Iterations between two checkpoints."""
    keep_checkpoints: Whole = 5
    """Checkpoints kept in the run folder, the newest ones; 0 keeps all."""
    spread_start: bool = True
    """Shift the episode clocks at the start, so that time limits do not strike in all worlds at once."""
    threads: Annotated[int, Ge(1), Le(MOST_THREADS)] | None = None
    """Processors of the run, for simulation and learning, of each process where there are several; by default
    SIMWARP_THREADS, or as many as the process may use. Learning is equal bit by bit for a given number."""
    torch_threads: Annotated[int, Ge(1), Le(MOST_THREADS)] = 1
    """Threads of one operation of torch on a CPU, where simwarp's own are not at work; small networks want one."""
    capture: bool = True
    """Capture each control step into a CUDA graph; of no effect on a CPU."""
    critic_warmup: Whole = 0
    """Iterations at the start in which only the critic learns; after a warm start, whose critic knows nothing."""
    logger: LoggerKind = LoggerKind.TENSORBOARD
    """Where scalars go beside progress.csv: tensorboard, wandb, or csv for nowhere else."""
    ppo: PPOConfig = PPOConfig()
    """The learning algorithm."""
    network: NetworkConfig = NetworkConfig()
    """The networks."""

    def validate(self) -> None:
        """Check that worlds, steps and mini-batches fit together."""
        if self.network.precision is not Precision.FLOAT32:
            seen = self.network.kind in _CONVOLVES and self.network.class_ is None
            require(seen, self.network, "precision", "float32 for a network without convolutions")
        if self.network.symmetric:
            plain = self.network.kind in (NetworkKind.MLP, NetworkKind.THESIS_MLP) and self.network.class_ is None
            require(plain, self.network, "symmetric", "off for other networks than mlp and thesis-mlp")
            unmixed = self.ppo.symmetry is Symmetry.NONE
            require(unmixed, self.ppo, "symmetry", "none for a network that is symmetric by construction")
        if self.network.recurrent:
            same = self.network.critic is CriticSees.SAME
            require(same, self.network, "critic", "same for a recurrent network, whose critic remembers too")
            # Mini-batches are then whole worlds, and a single one would lose its axis
            least = 2 * self.ppo.mini_batches
            require(self.num_envs >= least, self, "num_envs", f"at least {least}: two worlds per mini-batch")
            require(self.steps_per_iteration >= 2, self, "steps_per_iteration", "at least 2 for a recurrent network")
        if self.ppo.objective is Objective.KL_PENALTY:
            fixed = self.ppo.schedule in (Schedule.ADAPTIVE, Schedule.FIXED)
            require(fixed, self.ppo, "schedule", "left out under the KL penalty, which has a rule of its own")
        if self.ppo.symmetry is not Symmetry.NONE:
            clipped, feed_forward = self.ppo.objective is Objective.CLIP, not self.network.recurrent
            require(clipped, self.ppo, "symmetry", "none under the KL penalty")
            require(feed_forward, self.ppo, "symmetry", "none for a recurrent network")
        batch = self.num_envs * self.steps_per_iteration
        if batch < self.ppo.mini_batches:
            require(False, self, "num_envs", f"large enough for {self.ppo.mini_batches} mini-batches")


def default_config(task: type[Task[Any]], config: TaskConfig | None = None) -> TrainConfig:
    """Return the training configuration that a task asks for (``Task.training``) with its own configuration."""
    config = task.config_type() if config is None else config
    obs, variant = obs_of(config), variant_of(config) or ""
    fields = {**task.training, **task.training_by_obs.get(obs or "", {})}
    if obs == obs_of(replace_fields(task.config_type(), {"variant": variant} if variant else {})):
        fields |= task.training_by_variant.get(variant, {})
    return replace_fields(TrainConfig(), fields)


STUDENT: Mapping[str, Any] = {
    "iterations": 30, "steps_per_iteration": 16, "network.init_std": 0.2, "network.init_mean": (),
}  # fmt: skip
"""Defaults of a student's training, beside those that its task asks for. Its actions deviate a little, so that it
learns to come back to its teacher's way."""


def student_config(task: type[Task[Any]], config: TaskConfig | None = None) -> TrainConfig:
    """Return the training configuration of a student in a distillation: the task's own, and what it asks for besides
    (``Task.distilling``).
    """
    return replace_fields(default_config(task, config), {**STUDENT, **task.distilling})


_CLASSES = {
    NetworkKind.MLP: "networks:Perceptron",
    NetworkKind.THESIS_MLP: "networks:Perceptron",
    NetworkKind.RECURRENT: "networks:Recurrent",
    NetworkKind.MULTI_INPUT: "group_models:MultiInput",
    NetworkKind.NATURE_CNN: "networks:NatureCNN",
    NetworkKind.EARLY_FUSION: "networks:EarlyFusion",
    NetworkKind.LATE_FUSION: "networks:LateFusion",
}
_SEES_IMAGES = (NetworkKind.NATURE_CNN, NetworkKind.EARLY_FUSION, NetworkKind.LATE_FUSION)
_CONVOLVES = (*_SEES_IMAGES, NetworkKind.MULTI_INPUT)


def _model_config(
    network: NetworkConfig, kind: NetworkKind | None, action_size: int, kinds: Mapping[str, Any], prefix: str,
    mirror: Mirror | None,
) -> dict[str, Any]:  # fmt: skip
    """Return what actor and critic have in common; without a kind, of a network of an author's own."""
    model: dict[str, Any] = {
        "class_name": f"simwarp.train.networks.{_CLASSES[kind] if kind else 'own_network:own_network'}",
        "activation": network.activation.value,
        "obs_normalization": network.normalise,
        "init_weights": network.init_weights.value,
    }
    if mirror is not None:
        groups = {f"{prefix}{name}": one for name, one in mirror.observations.items()}
        model["class_name"] = "simwarp.train.networks.symmetric:SymmetricPerceptron"
        model["mirror"] = Mirror(groups, mirror.actions)
    if kind in (None, NetworkKind.MLP, NetworkKind.RECURRENT, NetworkKind.MULTI_INPUT):
        model["hidden_dims"] = list(network.hidden)
    if kind is None:
        model |= {"own": network.class_, "prefix": prefix}
    if kind is NetworkKind.MULTI_INPUT:
        named = {name: ObservationKind(value).value for name, value in kinds.items()}
        model |= {"kinds": named, "prefix": prefix}
        model |= {"features": network.features, "precision": network.precision.value}
    if kind is NetworkKind.RECURRENT:
        model |= {"rnn_type": network.cell.value, "rnn_hidden_dim": network.memory}
    if kind in _SEES_IMAGES:
        model |= {"action_size": action_size, "precision": network.precision.value}
    return model


def _algorithm_config(ppo: PPOConfig) -> dict[str, Any]:
    algorithm = {
        "class_name": "simwarp.train.algorithm.threaded_ppo:ThreadedPPO",
        "learning_rate": ppo.learning_rate,
        "schedule": (Schedule.ADAPTIVE if ppo.schedule is Schedule.ADAPTIVE else Schedule.FIXED).value,
        "desired_kl": ppo.desired_kl,
        "num_learning_epochs": ppo.epochs,
        "num_mini_batches": ppo.mini_batches,
        "clip_param": ppo.clip,
        "gamma": ppo.gamma,
        "lam": ppo.lam,
        "value_loss_coef": ppo.value_loss,
        "use_clipped_value_loss": ppo.clip_value_loss,
        "entropy_coef": ppo.entropy,
        "max_grad_norm": ppo.max_grad_norm,
        "rnd_cfg": None,
        "symmetry_cfg": None,
    }
    if ppo.objective is Objective.KL_PENALTY:
        algorithm |= {
            "class_name": "simwarp.train.algorithm.kl_penalty:KLPenaltyPPO",
            "schedule": Schedule.FIXED.value,
            "beta": ppo.kl_beta,
            "hinge": ppo.kl_hinge,
        }
    return algorithm


def _mean_actions(network: NetworkConfig, action_size: int) -> list[float]:
    """Return the mean action at the start, one number for each; none where the layers decide.

    Raises:
        InputError: there are other than one or one for each, or a tanh never reaches one.
    """
    mean = network.init_mean
    if len(mean) not in (0, 1, action_size):
        raise InputError(
            f"--network.init-mean must be one number or {action_size}, one for each action, got {len(mean)}: "
            f"{' '.join(map(str, mean))}; give one for all, or leave it out"
        )
    if network.tanh_output and any(abs(value) >= 1.0 for value in mean):
        raise InputError(
            f"--network.init-mean must be between -1 and 1 with --network.tanh-output, got {' '.join(map(str, mean))}; "
            "take numbers within, or --network.no-tanh-output"
        )
    return list(mean) * (action_size if len(mean) == 1 else 1)


def rsl_rl_config(
    config: TrainConfig, groups: list[str], action_size: int = 1, kinds: Mapping[str, Any] | None = None,
    prefix: str = "", mirror: Mirror | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Return the dictionary rsl-rl wants; a fresh one each time, since rsl-rl changes it.

    Args:
        config: the configuration.
        groups: observation groups that the actor sees, and the critic unless it is privileged.
        action_size: number of action components.
        kinds: group -> kind, where its shape does not say it (``Task.observation_kinds``).
        prefix: of the groups, before the names that the task and its networks know.
        mirror: of the task, for networks that are symmetric.

    Raises:
        InputError: the mean action at the start does not fit the actions.
    """
    network, kinds = config.network, kinds or {}
    kind = network.kind if network.class_ is None else None
    privileged = network.critic is CriticSees.PRIVILEGED
    return {
        "num_steps_per_env": config.steps_per_iteration,
        "save_interval": config.save_interval,
        "obs_groups": {"actor": list(groups), "critic": [CRITIC] if privileged else list(groups)},
        "algorithm": _algorithm_config(config.ppo),
        "actor": {
            **_model_config(network, kind, action_size, kinds, prefix, mirror),
            "tanh_output": network.tanh_output,
            "init_mean": _mean_actions(network, action_size),
            "distribution_cfg": {"class_name": "GaussianDistribution", "init_std": network.init_std},
        },
        "critic": _model_config(network, NetworkKind.MLP if privileged else kind, action_size, kinds, prefix, mirror),
    }


def train_config_from_plain(plain: object, where: str = "") -> TrainConfig:
    """Return the training configuration that :func:`~simwarp.tasks.config_to_plain` wrote.

    Args:
        plain: what was read: it may hold anything.
        where: where it stood: the errors begin with it.

    Raises:
        InputError: a name is unknown, or a value is of a wrong type or breaks its rule.
    """
    return config_from_plain(TrainConfig, with_current_threads(plain) if isinstance(plain, Mapping) else plain, where)


def configs_from_plain(content: Mapping[str, Any], where: str) -> tuple[TrainConfig, TaskConfig]:
    """Return the configurations in a checkpoint or of a run, held to their types and rules.

    Args:
        content: of the file.
        where: its location: the errors begin with it.

    Raises:
        InputError: one does not hold.
    """
    config = train_config_from_plain(content["train_config"], f"{where}: train_config")
    return config, task_config_from_plain(
        task_class_of(content, where), content["task_config"], f"{where}: task_config"
    )  # fmt: skip


def task_config_from_plain(task: type[Task[Any]], plain: object, where: str = "") -> TaskConfig:
    """Return the configuration of a task; see :func:`train_config_from_plain`."""
    return config_from_plain(task.config_type, plain, where)
