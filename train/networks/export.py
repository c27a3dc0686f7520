"""A policy as a file that runs without this package: ONNX or TorchScript, raw observations in, mean actions out.

Inputs are named after the observation groups, in the dtype the task has them; the normaliser is inside. The first axis
is the batch, of any size. A recurrent policy also takes and returns its memory, ``memory_0`` (and ``memory_1`` of an
LSTM), (layers, batch, units), zero at the start of an episode. Actions are not clipped: the task does that.
"""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import enum
import importlib.util
import io
import json
import logging
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch
from rsl_rl.models import MLPModel, RNNModel
from torch import nn

from simwarp.core.files import check_output, output_error, replacing
from simwarp.tasks import InputError, Task, make
from simwarp.tasks.framework.agent_rows import Rows

from ..algorithm.learner import TrainingError
from ..config import configs_from_plain
from ..runs.run_folder import read_policy
from .policies import NetworkPolicy, network_policy
from .policy_metadata import policy_metadata

TOLERANCE = 1e-5
"""Largest difference between an exported action and the trained one, relative to actions larger than 1."""
_META = "simwarp"
_OPSET = 18
_WORLDS, _STEPS = 8, 32
_ACTIONS = "actions"

Runner = Callable[..., tuple[torch.Tensor, ...]]


class ExportFormat(enum.Enum):
    """Kinds of file."""

    ONNX = "onnx"
    TORCHSCRIPT = "torchscript"


SUFFIXES = {ExportFormat.ONNX: ".onnx", ExportFormat.TORCHSCRIPT: ".ts"}


@dataclasses.dataclass(frozen=True)
class Export:
    """Description of an exported policy. The names are the keys of ``simwarp export --json``."""

    task: str
    checkpoint: str
    output: str
    format: str
    inputs: list[str]
    outputs: list[str]
    recurrent: bool
    samples: int
    max_difference: float


class ExportedPolicy(nn.Module):
    """An actor as a function of tensors alone.

    Args:
        policy: the trained policy; it is copied.
    """

    def __init__(self, policy: NetworkPolicy) -> None:
        super().__init__()
        actor = copy.deepcopy(policy.actor).cpu().eval()
        actor.reset()
        self.actor = actor
        self.groups = list(policy.groups)
        self.recurrent = isinstance(actor, RNNModel)
        self.cells = 0 if not isinstance(actor, RNNModel) else (2 if isinstance(actor.rnn.rnn, nn.LSTM) else 1)

    @property
    def inputs(self) -> list[str]:
        """Names of the inputs."""
        return [*self.groups, *(f"memory_{index}" for index in range(self.cells))]

    @property
    def outputs(self) -> list[str]:
        """Names of the outputs."""
        return [_ACTIONS, *(f"new_memory_{index}" for index in range(self.cells))]

    def memory(self, batch: int) -> tuple[torch.Tensor, ...]:
        """Return the memory at the start of an episode."""
        if not self.recurrent:
            return ()
        cell: nn.RNNBase = self.actor.rnn.rnn
        return tuple(torch.zeros(cell.num_layers, batch, cell.hidden_size) for _ in range(self.cells))

    def forward(self, *tensors: torch.Tensor) -> torch.Tensor | tuple[torch.Tensor, ...]:
        """Return the actions, and the new memory of a recurrent policy."""
        groups = dict(zip(self.groups, tensors, strict=False))
        if not self.recurrent:
            actions: torch.Tensor = self.actor(groups)
            return actions
        memory = tensors[len(self.groups) :]
        vectors = MLPModel.get_latent(self.actor, groups)
        latent, new = self.actor.rnn.rnn(vectors.unsqueeze(0), tuple(memory) if self.cells == 2 else memory[0])
        return (self._act(latent.squeeze(0)), *(new if self.cells == 2 else (new,)))

    def _act(self, latent: torch.Tensor) -> torch.Tensor:
        actions: torch.Tensor = self.actor.distribution.deterministic_output(self.actor.mlp(latent))
        return actions


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Suppress prints and warnings of exporters; they fail by exceptions."""
    level = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(level)


def _to_torchscript(policy: ExportedPolicy, example: tuple[torch.Tensor, ...], meta: dict[str, Any]) -> bytes:
    with _quiet(), torch.no_grad():
        traced: Any = torch.jit.trace(policy, example, check_trace=False)
        buffer = io.BytesIO()
        torch.jit.save(traced, buffer, _extra_files={f"{_META}.json": json.dumps(meta)})
    return buffer.getvalue()


def _to_onnx(
    policy: ExportedPolicy, example: tuple[torch.Tensor, ...], meta: dict[str, Any], told: dict[str, Any]
) -> bytes:
    if importlib.util.find_spec("onnxscript") is None:
        raise InputError("--format onnx needs the package onnxscript: pip install onnxscript, or --format torchscript")
    import onnx

    batch = torch.export.Dim("batch")
    count = len(policy.groups)
    shapes = tuple({0: batch} if index < count else {1: batch} for index in range(len(example)))
    with _quiet(), torch.no_grad():
        program = torch.onnx.export(
            policy,
            example,
            input_names=policy.inputs,
            output_names=policy.outputs,
            dynamic_shapes=(shapes,),
            opset_version=_OPSET,
            dynamo=True,
            verbose=False,
        )
        assert program is not None
        model = program.model_proto
    onnx.helper.set_model_props(model, {key: json.dumps(part) for key, part in {_META: meta, **told}.items()})
    data: bytes = model.SerializeToString()
    return data


def _load_torchscript(path: Path) -> Runner:
    with _quiet():
        module: Any = torch.jit.load(str(path), map_location="cpu")

    def run(*tensors: torch.Tensor) -> tuple[torch.Tensor, ...]:
        with torch.no_grad():
            out = module(*tensors)
        return out if isinstance(out, tuple) else (out,)

    return run


def _load_onnx(path: Path) -> Runner:
    """Return a function that runs the file: by onnxruntime where it is installed, else by the reference evaluator."""
    session: Any
    if importlib.util.find_spec("onnxruntime") is not None:
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
        names = [item.name for item in session.get_inputs()]
    else:
        from onnx.reference import ReferenceEvaluator

        session = ReferenceEvaluator(str(path))
        names = list(session.input_names)

    def run(*tensors: torch.Tensor) -> tuple[torch.Tensor, ...]:
        feed = {name: tensor.numpy() for name, tensor in zip(names, tensors, strict=True)}
        return tuple(torch.from_numpy(np.asarray(out)) for out in session.run(None, feed))

    return run


def load_exported(path: Path, form: ExportFormat) -> Runner:
    """Return an exported policy as a function: inputs in the order of ``Export.inputs``, all outputs as a tuple."""
    return _load_onnx(path) if form is ExportFormat.ONNX else _load_torchscript(path)


def _rollout(
    task: Task[Any], policy: NetworkPolicy
) -> list[tuple[dict[str, torch.Tensor], torch.Tensor, torch.Tensor]]:
    """Return observations, actions and ended episodes of some steps, noise on the actions so that much is seen."""
    task.keep_final_observations = False
    rows = Rows(task)
    observations = rows.restart(0)
    policy.reset_memory()
    steps = []
    for _ in range(_STEPS):
        seen = {name: group.clone() for name, group in observations.items()}
        actions = policy(observations).clone()
        size = task.action_size * task.agents
        noise = task.random.uniform("export", -0.5, 0.5, size, per_step=True).view_as(actions)
        result = rows.step(actions + noise)
        observations = result.observations
        ended = result.terminated | result.truncated
        policy.reset_memory(ended)
        steps.append((seen, actions, ended))
    return steps


def _difference(run: Runner, exported: ExportedPolicy, steps: list[Any]) -> float:
    """Return the largest difference of actions, relative to those larger than 1, over a rollout."""
    memory = exported.memory(_WORLDS)
    worst = 0.0
    for seen, actions, ended in steps:
        out, *cells = run(*(seen[name] for name in exported.groups), *memory)
        memory = tuple(cell * ~ended.view(1, -1, 1) for cell in cells)
        scale = actions.abs().clamp(min=1.0)
        worst = max(worst, float(((out - actions).abs() / scale).nan_to_num(float("inf")).max()))
    return worst


def export_model(checkpoint: Path, output: Path) -> tuple[str, ...]:
    """Write the robot and the ground that the policy of a checkpoint or run acts on as MJCF; return what is left out.

    Raises:
        InputError: the checkpoint cannot be read or does not fit its task, or the task has no physics.
        ModelError: the model has a part that MJCF has not.
        FileError: ``output`` cannot be written to.
        OutputError: the disk did not take the file.
    """
    from simwarp.exporters import save_mjcf

    target = check_output(output, "--mjcf")
    path, content = read_policy(checkpoint)
    _, config = configs_from_plain(content, f"checkpoint {path}")
    models = config.by_model()
    if models:
        rule = "--mjcf writes one model, and the policy drives several"
        raise InputError(f"{rule}: {', '.join(models)}; leave it away")
    task = make(content["task"], 1, seed=0, config=config)
    if task.simulation is None:
        raise InputError(f"--mjcf: task '{task.name}' has no physics that a model could tell of; leave it away")
    written: tuple[str, ...] = save_mjcf(task.simulation.model, target, timestep=config.dt / config.substeps).notes
    return written


def export_policy(checkpoint: Path, form: ExportFormat, output: Path | None = None) -> Export:
    """Write the policy of a checkpoint or run, and hold the file to the trained policy on raw observations.

    Args:
        checkpoint: checkpoint file or run folder.
        form: kind of file.
        output: file to write; by default ``TASK.onnx`` or ``TASK.ts`` in the working folder.

    Raises:
        InputError: the checkpoint cannot be read or does not fit its task.
        FileError: ``output`` cannot be written to.
        OutputError: the disk did not take the file.
        TrainingError: the exported policy differs from the trained one; no file is left.
    """
    if output is not None:
        check_output(output, "--output")
    path, content = read_policy(checkpoint)
    name = content["task"]
    _, config = configs_from_plain(content, f"checkpoint {path}")
    target = check_output(output or Path(f"{name}{SUFFIXES[form]}"), "--output")
    task = make(name, _WORLDS, seed=0, config=config)
    policy = network_policy(content, task)
    exported = ExportedPolicy(policy)
    steps = _rollout(task, policy)
    example = (*(steps[0][0][group] for group in exported.groups), *exported.memory(_WORLDS))
    meta = {"task": name, "iteration": content["iteration"], "inputs": exported.inputs, "outputs": exported.outputs}
    if form is ExportFormat.ONNX:
        data = _to_onnx(exported, example, meta, policy_metadata(task))
    else:
        data = _to_torchscript(exported, example, meta)
    # The file itself is what is checked, under another name until it has passed
    with replacing(target) as draft:
        try:
            draft.write_bytes(data)
        except OSError as error:
            raise output_error(target, error, draft, len(data)) from error
        difference = _difference(load_exported(draft, form), exported, steps)
        if not difference <= TOLERANCE:
            raise TrainingError(
                f"the exported policy differs from the trained one by {difference:.2g}, more than {TOLERANCE:g};"
                " nothing was written"
            )
    return Export(
        task=name,
        checkpoint=str(path),
        output=str(target),
        format=form.value,
        inputs=exported.inputs,
        outputs=exported.outputs,
        recurrent=exported.recurrent,
        samples=_WORLDS * _STEPS,
        max_difference=difference,
    )
