"""Recordings for the tools of ROS 2: MCAP files of one world, with the messages of its state and its sensors.

    with sw.mcap.Writer("run.mcap", simulation) as writer:
        for _ in range(1000):
            simulation.step()
            writer.add()

`docs/record.md` lists topics, frames and units. It needs the extra `simwarp[mcap]`, and no ROS.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from simwarp.core.names_on_demand import names_on_demand

if TYPE_CHECKING:
    from simwarp.mcap.mcap_writer import Writer as Writer

__all__ = ["Writer"]
__getattr__ = names_on_demand(__name__, {"Writer": "mcap_writer"})
