"""``python -m simwarp`` is the command ``simwarp``."""

import sys

from simwarp.cli import main

if __name__ == "__main__":
    sys.exit(main())
