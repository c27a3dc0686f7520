"""The configuration every task shares, and the checks its fields obey."""

from __future__ import annotations

import dataclasses
import enum
import inspect
import json
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Final, Self, TypeAlias, TypeVar

import tyro

from simwarp.core.constraints import Count, Ge, Le, NotNegative, Positive
from simwarp.core.files import parse_json
from simwarp.core.types import formatted

from ..randomisation.randomisation_config import Curriculum, Delay, Range, Sensing, Uncertainty
from .config_values import Settings, plain_value, typed
from .errors import InputError, near_names
from .mixing import Mix, parse_mix
from .variants import variant_of

ConfigT = TypeVar("ConfigT")


def require(condition: bool, config: object, field: str, rule: str) -> None:
    """Raise an :class:`InputError` that names the field, the rule and the value, unless it holds.

    Raises:
        InputError: the condition does not hold.
    """
    if not condition:
        value = getattr(config, field)
        raise InputError(f"{field.replace('_', '-')} must be {rule}, got {formatted(value)}")


def replace_fields(config: ConfigT, changes: Mapping[str, Any]) -> ConfigT:
    """Return ``config`` with some fields replaced; ``"ppo.gamma"`` reaches into a nested config.

    Another ``variant`` sets the fields of both variants anew, but for those that are in ``changes`` too.

    Raises:
        InputError: there is no such field, or the new value breaks its rule.
    """
    grouped: dict[str, dict[str, Any]] = {}
    direct: dict[str, Any] = {}
    names = {field.name for field in dataclasses.fields(config)}  # type: ignore[arg-type]
    for key, value in changes.items():
        head, _, rest = key.partition(".")
        if head not in names:
            raise InputError(f"{type(config).__name__} has no field '{head}'{near_names(head, names)}")
        if rest:
            grouped.setdefault(head, {})[rest] = value
        else:
            like = getattr(config, head)
            direct[head] = typed(type(like), value, head.replace("_", "-")) if isinstance(like, enum.Enum) else value
    if isinstance(config, TaskConfig) and "variant" in direct:
        direct = {**_other_variant(config, direct["variant"].value), **direct}
    for head, nested in grouped.items():
        direct[head] = replace_fields(direct.get(head, getattr(config, head)), nested)
    return dataclasses.replace(config, **direct)  # type: ignore[type-var]


def _other_variant(config: TaskConfig, variant: str) -> dict[str, Any]:
    """Return the fields that change from the variant of a configuration to another: values by name."""
    kind, own = type(config), variant_of(config)
    if variant == own:
        return {}
    usual = kind()
    return {name: getattr(usual, name) for name in kind.fields_of(own or "")} | kind.fields_of(variant)


def _settings_by_name(arguments: list[str]) -> dict[str, Any]:
    """Read one JSON object from the command line."""
    value = parse_json(arguments[0], "JSON")
    if not isinstance(value, dict):
        raise ValueError('must be a JSON object: {"name": {"field": value}}')
    return value


def _as_json(value: Mapping[str, Any]) -> list[str]:
    plain = {
        name: dataclasses.asdict(entry) if dataclasses.is_dataclass(entry) and not isinstance(entry, type) else entry
        for name, entry in value.items()
    }
    return [json.dumps(plain_value(plain))]


BY_NAME: Final = tyro.constructors.PrimitiveConstructorSpec(
    nargs=1,
    metavar="JSON",
    instance_from_str=_settings_by_name,
    is_instance=lambda value: isinstance(value, Mapping),
    str_from_instance=_as_json,
)
"""A mapping from names to settings is one JSON object on the command line."""
RangesByName: TypeAlias = Annotated[Mapping[str, Range], BY_NAME]
SensingByName: TypeAlias = Annotated[Mapping[str, Sensing], BY_NAME]


@dataclasses.dataclass(frozen=True)
class RewardWeights(Settings):
    """Base of the weights of a task's rewards: a number for each term, under its name, negative where it is a penalty.

    A task's configuration has them as its field ``rewards``.
    """

    NAMED: ClassVar[bool] = True


@dataclasses.dataclass(frozen=True)
class TaskConfig(Settings):
    """Fields that every task has; a task adds its own in a frozen subclass.

    One whose task has variants has the field ``variant`` too, an enumeration, which sets all fields of `VARIANTS` that
    are not given beside it.
    """

    VARIANTS: ClassVar[Mapping[str, Mapping[str, Any]]] = {}
    """Variant -> field -> value, where it is not the default; ``"rewards.goal"`` reaches into nested ones."""

    dt: Positive = 0.01
    """Physics step [s]."""
    substeps: Count = 1
    """Sub-steps of dt / substeps inside one physics step."""
    decimation: Annotated[int, Ge(1), Le(100_000)] = 1
    """Physics steps per control step; one action lasts decimation * dt seconds."""
    max_episode_steps: Annotated[int, Ge(1), Le(10**9)] = 1000
    """Control steps after which an episode is truncated."""
    action_rise_time: NotNegative | tuple[NotNegative, ...] = 0.0
    """Time an action takes from 0 to 1 [s], of all components or of each: it moves towards what the policy asks for by
    at most dt / rise time per physics step; 0 is at once."""
    action_delay: Delay = (0, 0)
    """Least and largest delay of the actions [control steps], drawn for every world and episode."""
    guard_steps: Annotated[int, Ge(0), Le(10000)] = 100
    """Control steps kept in memory for the dump of a world whose physics breaks down; 0 keeps none."""
    randomise: RangesByName = dataclasses.field(default_factory=dict)
    """Model parameter -> range: what differs from world to world and from episode to episode."""
    sensing: SensingByName = dataclasses.field(default_factory=dict)
    """Observation group -> noise, bias and delay."""
    curriculum: Curriculum = dataclasses.field(default_factory=Curriculum)
    """What moves the level of difficulty."""
    mix: str = ""
    """Several models in one batch, a group of worlds for each: a field and its values, such as full=false,true."""
    mix_shares: tuple[Positive, ...] = ()
    """Shares of the worlds that the models of a mix have, in their order; empty: equal ones."""

    def __init_subclass__(cls, **options: Any) -> None:
        """Keep how `randomise` and `sensing` are read where a task declares them again, for defaults of its own."""
        super().__init_subclass__(**options)
        own = inspect.get_annotations(cls)
        for name, kind in (("randomise", RangesByName), ("sensing", SensingByName)):
            if name in own:
                cls.__annotations__[name] = kind

    def __new__(cls, *values: Any, **fields: Any) -> Self:
        """Note which fields are given: the variant sets the others."""
        made = super().__new__(cls)
        if values or fields:
            names = [field.name for field in dataclasses.fields(cls)]
            object.__setattr__(made, "_given", {*names[: len(values)], *fields})
        return made

    def __post_init__(self) -> None:
        """Set the fields of the variant that are not given, and hold all to their types; check the models of a mix."""
        given = vars(self).pop("_given", None)
        if given is not None:  # where none is noted all are at their defaults, or read from a file
            variant = getattr(self, "variant", "")
            for name, value in self.fields_of(str(getattr(variant, "value", variant))).items():
                if name not in given:
                    object.__setattr__(self, name, value)
        super().__post_init__()
        self.by_model()

    @classmethod
    def fields_of(cls, variant: str) -> dict[str, Any]:
        """Return the fields that a variant sets, values by name; none of one that sets nothing.

        Args:
            variant: its name.
        """
        changes = cls.VARIANTS.get(variant)
        if not changes:
            return {}
        made = replace_fields(cls(), changes)
        return {name: getattr(made, name) for name in (key.partition(".")[0] for key in changes)}

    @property
    def uncertainty(self) -> Uncertainty:
        """What is drawn in force: `randomise`, `sensing` and `action_delay`.

        A configuration overrides it where fields of its own stand for some of it.
        """
        return Uncertainty(self.randomise, self.sensing, self.action_delay)

    def validate(self) -> None:
        """Check that there are weights of terms alone; subclasses call ``super()``."""
        self.reward_weights()

    def usual_weights(self) -> Mapping[str, float]:
        """Return weights, dimensionless, of terms whose weight in ``rewards`` is None: of a reward with variants."""
        return {}

    def reward_weights(self) -> dict[str, float]:
        """Return the weights of the reward terms, dimensionless, by name: those of the field ``rewards``, if any.

        Raises:
            InputError: there is a weight for a term that this variant of the reward does not have.
        """
        rewards, usual = getattr(self, "rewards", None), self.usual_weights()
        given = {} if rewards is None else dataclasses.asdict(rewards)
        given = {name: weight for name, weight in given.items() if weight is not None}
        for name in given.keys() - usual.keys() if usual else ():
            option = f"rewards.{name.replace('_', '-')}"
            raise InputError(f"{option}: this variant of the reward has no such term; known: {', '.join(usual)}")
        return {**usual, **given}

    def mixed(self) -> Mix | None:
        """Return what differs between the models that share the batch; None: there is one model."""
        return parse_mix(self.mix)

    def by_model(self) -> dict[str, Self]:
        """Return the configurations of the models that share the batch, by name; empty: there is one model.

        Raises:
            InputError: the field that differs is unknown, or a model's value of it breaks its rule.
        """
        mix = self.mixed()
        if mix is None:
            return {}
        like: Any = self
        for part in mix.field.split("."):
            like = getattr(like, part, None)
        alone = {"mix": "", "mix_shares": ()}
        return {word: replace_fields(self, {**alone, mix.field: mix.value(word, like)}) for word in mix.words}

    @property
    def control_dt(self) -> float:
        """Time between two actions [s]."""
        return self.dt * self.decimation


def obs_of(config: TaskConfig) -> str | None:
    """Return which observations a task's configuration chooses (its field ``obs``); None if there is no choice."""
    obs = getattr(config, "obs", None)
    return str(obs.value) if isinstance(obs, enum.Enum) else None
