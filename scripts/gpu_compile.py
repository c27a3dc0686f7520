"""Time to compile every large kernel on a GPU, cold: `python -m scripts.gpu_compile cuda:0 OUT.json`.

Point WARP_CACHE_PATH at an empty folder first.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import warp as wp

from scripts.gpu_static import modules
from simwarp.bench.machine import describe


def main(device: str, out: str) -> int:
    """Load them one after the other, then tell."""
    rows = []
    for name, module in modules(""):
        begin = time.perf_counter()
        module.load(wp.get_device(device), block_dim=32)
        rows.append({"kernel": name, "seconds": time.perf_counter() - begin})
        print(f"{name:32}{rows[-1]['seconds']:8.1f} s", flush=True)
    found = {"machine": describe(wp.get_device(device)), "kernels": rows}
    Path(out).write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
