"""``python -m controller.cli``: the same as ``cellctl``."""

import sys

from . import main

if __name__ == "__main__":
    sys.exit(main())
