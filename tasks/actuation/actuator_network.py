"""A learned actuator: a network that has seen a motor on a test bench tells its torque.

Hwangbo et al., "Learning agile and dynamic motor skills for legged robots", Science Robotics 4 (2019): the torque of a
joint follows from the errors of its position and from its rates, now and some physics steps ago. One small perceptron
serves all joints. The file is TorchScript, as other simulators keep such networks too.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import torch

from simwarp.core.object_repr import Names, Readable, Row
from simwarp.core.types import formatted

from ..framework.errors import InputError, near_names
from ..framework.task import Task

MOST_HISTORY: Final = 1000
"""Physics steps that are looked back, at most."""


class ActuatorNetwork(Readable):
    """The motors of some hinges or slides, one network for all of them.

    Its input is a row for each joint of each world: errors target - q of the steps in ``history``, then rates of the
    same steps, each times its scale; with ``rates_first`` the other way round. Its output times ``torque_scale``,
    bounded by the effort limit, is the torque of the next physics step. Before an episode begins, errors and rates were
    zero.

    A task owns one: it makes it in ``setup``, and calls

    - ``follow(target)`` in ``apply``,
    - ``advance()`` in ``after_physics``,
    - ``begin(world_mask)`` in ``reset``,
    - ``state()`` and ``load_state(state)`` in ``extra_state`` and ``load_extra_state``.

    It writes the joints' columns of ``Control.joint_force``: give them no drive.

    Args:
        task: whose joints they are.
        path: of the TorchScript file.
        joints: names.
        history: how many physics steps ago the inputs are of, the present first.
        error_scale: factor of position errors.
        rate_scale: factor of rates.
        torque_scale: factor of the network's output [N·m or N].
        effort_limit: largest torque or force either way [N·m or N].
        rates_first: rates come before errors.

    Attributes:
        joints: names, in the order of the columns.
        torque: (W, J) float32, what acts in the next physics step [N·m or N].
        target: (W, J) float32 [rad or m].
        strength: (W, J) float32 factor of the torque, 1 as made: a task may write it.

    Raises:
        InputError: the file is no TorchScript, its network has other inputs or outputs, or a joint cannot have a motor.
    """

    def __init__(
        self, task: Task[Any], path: str | Path, joints: Sequence[str], *, history: Sequence[int] = (0, 1, 2),
        error_scale: float = 1.0, rate_scale: float = 1.0, torque_scale: float = 1.0,
        effort_limit: float = float("inf"), rates_first: bool = False,
    ) -> None:  # fmt: skip
        self._columns = _columns_of(task, joints)
        self.joints = tuple(joints)
        self._steps = _checked_history(history)
        if not effort_limit > 0.0:
            raise InputError(f"actuator network: effort_limit must be > 0, got {formatted(effort_limit)}; leave it out")
        self._views = task.views
        self._scales = (float(error_scale), float(rate_scale), float(torque_scale))
        self._limit, self._rates_first = float(effort_limit), bool(rates_first)
        rises = task.config.action_rise_time  # limited actions are applied in every physics step
        limited = any(time > 0.0 for time in (rises if isinstance(rises, tuple) else (rises,)))
        self._again = 0 if limited else task.config.decimation - 1
        """Torques after the one of `follow`, until the next control step."""
        self._left = 0
        self.network = load_actuator_network(path, 2 * len(self._steps), str(task.device))
        size, device = (task.num_worlds, len(self._columns)), task.device
        self._dofs = torch.tensor(self._columns, device=device)
        self._chosen = torch.tensor(self._steps, device=device)
        depth = max(self._steps) + 1
        self._errors, self._rates = (torch.zeros(*size, depth, device=device) for _ in range(2))
        self.target, self.torque = torch.zeros(size, device=device), torch.zeros(size, device=device)
        self.strength = torch.ones(size, device=device)

    def _readable_title(self) -> str:
        return f": {len(self.joints)} joints, {len(self.target)} worlds"

    def _readable_rows(self) -> dict[str, Row]:
        steps = ", ".join(map(str, self._steps))
        return {"joints": Names(len(self.joints), self.joints), "looks back": f"{steps} physics steps"}

    def follow(self, target: torch.Tensor) -> None:
        """Take a target ((W, J) [rad or m]), and set the torques of the next physics step: for ``apply``."""
        self.target.copy_(target)
        self._act()
        self._left = self._again

    def advance(self) -> None:
        """Set the torques of the next physics step of the same control step: for ``after_physics``."""
        if self._left > 0:
            self._act()
            self._left -= 1

    def begin(self, world_mask: torch.Tensor) -> None:
        """Forget what was, in the worlds of a mask ((W,) bool): for ``reset``."""
        for tensor in (self._errors, self._rates, self.target, self.torque):
            tensor.masked_fill_(world_mask.view(-1, *(1,) * (tensor.dim() - 1)), 0.0)

    def state(self, prefix: str = "actuator network") -> dict[str, torch.Tensor]:
        """Return what a checkpoint keeps, tensors (W, ...) by name: for ``extra_state``.

        Args:
            prefix: of the names, where a task has several.
        """
        parts = {"errors": self._errors, "rates": self._rates, "target": self.target, "torque": self.torque}
        return {f"{prefix} {name}": tensor for name, tensor in parts.items()}

    def load_state(self, state: Mapping[str, torch.Tensor], prefix: str = "actuator network") -> None:
        """Take back what :meth:`state` returned, tensors (W, ...): for ``load_extra_state``."""
        for name, tensor in self.state(prefix).items():
            tensor.copy_(state[name])

    def _act(self) -> None:
        """Take the present into the history, and ask the network."""
        error_scale, rate_scale, torque_scale = self._scales
        for line, now in (
            (self._errors, self.target - self._views.joint_q.index_select(1, self._dofs)),
            (self._rates, self._views.joint_qd.index_select(1, self._dofs)),
        ):
            line.copy_(line.roll(1, dims=2))
            line[:, :, 0].copy_(now)
        errors = self._errors.index_select(2, self._chosen) * error_scale
        rates = self._rates.index_select(2, self._chosen) * rate_scale
        inputs = torch.cat((rates, errors) if self._rates_first else (errors, rates), dim=2)
        with torch.no_grad():
            told = self.network(inputs.flatten(0, 1)).view_as(self.torque)
        torch.clamp(torque_scale * told * self.strength, -self._limit, self._limit, out=self.torque)
        self._views.joint_force.index_copy_(1, self._dofs, self.torque)


def load_actuator_network(path: str | Path, inputs: int, device: str = "cpu") -> Any:
    """Return the network of a TorchScript file, held to its shapes: (N, inputs) float32 in, (N, 1) or (N,) out.

    Args:
        path: of the file.
        inputs: numbers of a row.
        device: that it runs on.

    Raises:
        InputError: there is no such file, it is no TorchScript, or its network has other shapes.
    """
    file = Path(path)
    thing = f"actuator network '{file}'"
    if not file.is_file():
        raise InputError(
            f"{thing}: there is no such file; save one with torch.jit.save(torch.jit.script(network), path)"
        )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # of TorchScript as such
            network = torch.jit.load(str(file), map_location=device).eval()
    except (RuntimeError, ValueError, OSError) as error:
        first = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        raise InputError(
            f"{thing} must be TorchScript, got another kind of file ({first[:80]}); save it with torch.jit.save"
        ) from None
    probe = torch.zeros(3, inputs, device=device)
    try:
        with torch.no_grad():
            told = network(probe)
    except RuntimeError:
        raise InputError(
            f"{thing} must take rows of {inputs} numbers, errors and rates of each step of `history`, and does not; "
            "give the history that it was trained with"
        ) from None
    if not isinstance(told, torch.Tensor) or told.numel() != 3 or told.dtype != torch.float32:
        got = f"{told.dtype} of shape {tuple(told.shape)}" if isinstance(told, torch.Tensor) else formatted(told)
        raise InputError(f"{thing} must return one float32 for each of 3 rows, got {got}; let it have one output")
    if not bool(told.isfinite().all()):
        raise InputError(f"{thing} must return finite numbers at zero, got NaN or infinity; train it again")
    return network


def _columns_of(task: Task[Any], joints: Sequence[str]) -> list[int]:
    """Columns of `joint_q` of hinges and slides without a drive."""
    if isinstance(joints, str) or not joints:
        raise InputError(f"actuator network: joints must be a list of names, got {formatted(joints)}; write [...]")
    if task.simulation is None:
        raise InputError(f"actuator network: task '{task.name}' has no physics, and so no joints")
    model = task.simulation.model
    columns = []
    for name in joints:
        if name not in model.joint_names:
            known = near_names(str(name), model.joint_names)
            raise InputError(f"actuator network: task '{task.name}' has no joint {formatted(name)}{known}")
        spec = model.builder.joints[model.joint(name)]
        if len(spec.dofs) != 1:
            raise InputError(
                f"actuator network: joint '{name}' has {len(spec.dofs)} coordinates; name hinges and slides"
            )
        if spec.dofs[0].drive is not None:
            kind = type(spec.dofs[0].drive).__name__
            raise InputError(f"actuator network: joint '{name}' has a {kind} already; build it without a drive")
        columns.append(model.dof(name))
    return columns


def _checked_history(history: Sequence[int]) -> list[int]:
    """Steps to look back, whole numbers from 0 on."""
    steps = list(history) if not isinstance(history, str) else []
    whole = all(isinstance(step, int) and not isinstance(step, bool) and 0 <= step <= MOST_HISTORY for step in steps)
    if not steps or not whole or len(set(steps)) < len(steps):
        raise InputError(
            f"actuator network: history must be different whole numbers of steps from 0 on, got {formatted(history)}; "
            "(0, 1, 2) are the last three"
        )
    return steps
