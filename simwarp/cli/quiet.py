"""Starting Warp without its banner, so that ``--json -`` and one-line errors are all that is printed."""

from __future__ import annotations

import os
import sys
import tempfile

# Warp's native library prints this on every machine without a GPU; `simwarp doctor` says it better
_NO_DRIVER = "Could not find or load the NVIDIA CUDA driver"


def start_warp() -> None:
    """Initialise Warp; its warnings still show, but neither its banner nor that there is no GPU."""
    import warp as wp

    wp.config.log_level = wp.LOG_WARNING
    sys.stderr.flush()
    try:
        kept = os.dup(2)
    except OSError:  # standard error is closed: nothing to tidy
        wp.init()
        return
    # The message comes from C, so that only the file descriptor can be redirected
    with tempfile.TemporaryFile() as caught:
        os.dup2(caught.fileno(), 2)
        try:
            wp.init()
        finally:
            os.dup2(kept, 2)
            os.close(kept)
        caught.seek(0)
        for line in caught.read().decode(errors="replace").splitlines():
            if _NO_DRIVER not in line:
                print(line, file=sys.stderr)
