"""``simwarp export``."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Literal

from simwarp.cli import DONE
from simwarp.cli.options import CommonOptions, parse_options, split_path


@dataclasses.dataclass(frozen=True)
class ExportOptions(CommonOptions):
    """Write a policy, its observation normaliser included, as a file that runs without simwarp; and check the file."""

    format: Literal["onnx", "torchscript"] = "onnx"
    """Kind of file."""
    output: Path | None = None
    """File to write; by default TASK.onnx or TASK.ts in the working folder."""
    mjcf: Path | None = None
    """Also write the robot and the ground that the policy acts on, as a file of MuJoCo; the model must be a tree."""


def run(arguments: list[str]) -> int:
    """Export as the arguments say."""
    source, arguments = split_path(arguments, "export", "RUN_OR_CHECKPOINT")
    options = parse_options(ExportOptions, arguments, "simwarp export RUN_OR_CHECKPOINT")
    options.check(source, output=options.output, mjcf=options.mjcf)
    import torch

    from simwarp.train.networks.export import ExportFormat, export_model, export_policy

    torch.set_num_threads(1)
    told = {} if options.mjcf is None else {"mjcf": str(options.mjcf)}
    left_out = export_model(source, options.mjcf) if options.mjcf is not None else ()
    result = export_policy(source, ExportFormat(options.format), options.output)
    console = options.console()
    console.print(
        f"largest difference from the trained policy over {result.samples} observations: {result.max_difference:.2g}",
        highlight=False,
        soft_wrap=True,
    )
    console.print(f"wrote {result.output}", highlight=False, soft_wrap=True)
    if options.mjcf is not None:
        console.print(f"wrote {options.mjcf}", highlight=False, soft_wrap=True)
    for line in left_out:
        console.print(f"left out of it: {line}", highlight=False, soft_wrap=True)
    options.emit({**dataclasses.asdict(result), **told})
    return DONE
