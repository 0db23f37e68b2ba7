"""Versions of what a verdict is computed with."""

import platform
import sys
from importlib.metadata import version


def software_versions() -> dict[str, str]:
    """Return versions by name, for journal and reports."""
    return {
        "cellctl": version("cellctl"),
        "python": sys.version.split()[0],
        "system": platform.platform(terse=True),
    }
