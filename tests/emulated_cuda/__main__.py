"""`python -m tests.emulated_cuda [-m MODULE | SCRIPT] ...`: Python with the emulated CUDA device, in this folder.

`python CHECKOUT/tests/emulated_cuda ...` does the same from any folder.
"""

import os
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1]))

from tests.emulated_cuda.settings import SWITCH, why_unavailable  # noqa: E402


def main() -> None:
    """Replace this process by Python with the device."""
    reason = why_unavailable()
    if reason:
        sys.exit(reason)
    paths = [str(HERE / "site"), os.environ.get("PYTHONPATH", "")]
    environment = {
        f"{SWITCH}_REPORT": "1", "SIMWARP_THREADS": "1", "OMP_NUM_THREADS": "1", **os.environ, SWITCH: "1",
        "PYTHONPATH": os.pathsep.join(filter(None, paths)),
    }  # fmt: skip
    os.execve(sys.executable, [sys.executable, *sys.argv[1:]], environment)


main()
