"""Where the extra is not installed, everything that needs it says so in one line."""

import subprocess
import sys

import pytest

BLOCKED = """
import sys
for name in ("viser", "zstandard", "websockets"):
    sys.modules[name] = None
from simwarp.cli import main
sys.exit(main({arguments!r}))
"""


@pytest.mark.parametrize(
    "arguments",
    [
        ["play", "fast", "--checkpoint", "zero", "--html", "a.html"],
        ["view", "four-bar", "--record", "a.html", "--seconds", "1"],
        ["train", "fast", "--iterations", "1", "--film", "1"],
    ],
    ids=lambda arguments: arguments[0],
)
def test_the_extra_is_named_in_one_line(arguments, tmp_path):
    code = BLOCKED.format(arguments=arguments)
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=200)
    assert done.returncode == 2
    assert "viser must be installed" in done.stderr
    assert "pip install 'simwarp[viewer]'" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
