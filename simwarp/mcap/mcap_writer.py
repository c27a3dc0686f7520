"""Records one world of a simulation as a file of ROS 2 messages."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import TracebackType

from simwarp.core.object_repr import Readable
from simwarp.core.types import ModelError, formatted
from simwarp.mcap.mcap_extra import check_mcap_path
from simwarp.mcap.mcap_file import Compression, McapFile
from simwarp.ros2.world_topics import RATE, WorldTopics, base_of, checked_rate, checked_world
from simwarp.simulation.simulation import Simulation


class Writer(Readable):
    """Records a world: its clock, transforms, odometry, joints, the wheels of a vehicle, and all frames of its sensors.

    ::

        with sw.mcap.Writer("run.mcap", simulation) as writer:
            for _ in range(1000):
                simulation.step()
                writer.add()

    Nothing in the simulation changes by it. Time goes on where a world is reset: an episode begins where the last one
    ended. Chunks of the file are complete while it grows, so that a crash leaves all but the last second.

    Args:
        path: of the file, .mcap; it is replaced.
        simulation: whose world is recorded.
        world: which.
        rate: of the topics of the state [Hz]; they are written at calls of `add`. Sensors come at rates of their own.
        base: body of the frame `base_link`, by name or index; None: the chassis of the first vehicle, else body 0.
        compression: of the chunks: "lz4", "zstd" (smaller and slower), or "none".

    Attributes:
        path: of the file.
        left_out: names of sensors of classes that have no message.

    Raises:
        ModelError: the extra is not installed, the name ends otherwise, or there is no such world or body.
        FileError: the file cannot be written to.
        OutputError: the disk did not take it; so does `add`. What was recorded up to then can be read.
    """

    def __init__(
        self, path: str | Path, simulation: Simulation, *, world: int = 0, rate: float = RATE,
        base: str | int | None = None, compression: str = "lz4",
    ) -> None:  # fmt: skip
        self.path: Path = check_mcap_path(path, "Writer")
        # Before the file is made
        checked_world("Writer", simulation, world)
        checked_rate("Writer", rate)
        base_of("Writer", simulation, base)
        if compression not in {each.value for each in Compression}:
            raise ModelError(f"Writer: compression must be lz4, zstd or none, got {formatted(compression)}; take lz4")
        self._file = McapFile(self.path, Compression(compression))
        self._topics = WorldTopics(self._file, simulation, thing="Writer", world=world, rate=rate, base=base)
        self.left_out: list[str] = self._topics.left_out
        self.add()

    def _readable_title(self) -> str:
        return f": {self._file.messages} messages in '{self.path}'"

    @property
    def elapsed(self) -> float:
        """Time from the beginning to the last call of `add` [s]."""
        return self._topics.elapsed

    @property
    def size(self) -> int:
        """Bytes of all messages, before compression."""
        return self._file.size

    @property
    def missed(self) -> dict[str, int]:
        """Frames that came and went between two calls of `add`, by the sensor's name; 0: none was lost."""
        return self._topics.missed

    def steps_to_next(self) -> int:
        """Steps until `add` has something to record, at least 1: they may be taken at once, without a call in between,
        where no world is reset meanwhile. The record is the same.
        """
        return self._topics.steps_to_next()

    def add(self, commands: Mapping[str, float] | None = None) -> None:
        """Records what is new: frames of sensors, and the state where it is due.

        To be called after every step, or after `steps_to_next` of them.

        Args:
            commands: numbers by name, dimensionless or in SI, for the topic `/commands`; the same names in every call.

        Raises:
            ModelError: the file is closed, or names of the commands have changed.
            OutputError: the disk did not take it.
        """
        if self._file.closed:
            raise ModelError(f"Writer: '{self.path}' is closed and takes no more; make another Writer")
        self._topics.add(commands)
        self._file.tick()

    def flush(self) -> None:
        """Ends the chunk: what was recorded up to now survives a crash. It happens by itself after a second.

        Raises:
            OutputError: the disk did not take it.
        """
        self._file.flush()

    def close(self) -> None:
        """Ends the file; a second call does nothing.

        Raises:
            OutputError: the disk did not take it.
        """
        self._file.close()

    def __enter__(self) -> Writer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
