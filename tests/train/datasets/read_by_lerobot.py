"""Opens a dataset with lerobot, reads all of it, and writes what it found to a file of arrays.

Run by test_lerobot_reads.py in an environment of its own, which has lerobot and no simwarp.
"""

import json
import sys
from typing import Any

import numpy as np
from lerobot.datasets.lerobot_dataset import LeRobotDataset


def main(folder: str, output: str, every: int) -> None:
    """Read every so many rows of a dataset, one by one as a training does."""
    dataset = LeRobotDataset("simwarp/recorded", root=folder)
    rows = [dataset[index] for index in range(0, len(dataset), every)]
    words = {name for name, value in rows[0].items() if isinstance(value, str)}
    arrays: Any = {name: np.stack([np.asarray(row[name]) for row in rows]) for name in rows[0] if name not in words}
    meta, episodes = dataset.meta, [dataset.meta.episodes[index] for index in range(dataset.num_episodes)]
    about = {
        "fps": dataset.fps,
        "episodes": dataset.num_episodes,
        "rows": len(dataset),
        "tasks": sorted({row["task"] for row in rows}),
        "lengths": [one["length"] for one in episodes],
        "worlds": [[one[f"simwarp/{name}"] for name in ("world", "episode", "seed")] for one in episodes],
        "names": {name: feature["names"] for name, feature in dataset.features.items()},
        "statistics": {name: {key: value.tolist() for key, value in own.items()} for name, own in meta.stats.items()},
    }
    np.savez(output, about=np.array(json.dumps(about)), **arrays)
    # The next rows of each, as policies that act in chunks ask for
    ahead = {"action": [index / dataset.fps for index in range(3)]}
    chunks = LeRobotDataset("simwarp/recorded", root=folder, delta_timestamps=ahead)
    assert chunks[0]["action"].shape == (3, *arrays["action"].shape[1:])


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]))
