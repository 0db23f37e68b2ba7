"""The version of cellctl, its commit, and versions of what a verdict is computed with.

In a checkout the commit comes from git; a wheel or an sdist has a stamp instead, which `setup.py`
writes as it builds them. Only the standard library is imported here: `setup.py` runs this file by
itself.
"""

import os
import platform
import subprocess
import sys
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final

STAMP: Final = "commit.txt"  # stamp beside this file, in wheels and sdists alone
_CHECKOUT: Final = Path(__file__).resolve().parents[2]
# Longest wait for git [s]. It answers within 0.1 s; a disk that hangs must not hold up a run.
_GIT_WALL_S: Final = 5.0
UNKNOWN: Final = "unknown"


def installed_version() -> str:
    """Return the version of the installed package; cellctl may run without being installed."""
    try:
        return version("cellctl")
    except PackageNotFoundError:
        return "(not installed)"


@cache
def commit() -> str:
    """Return the commit of this code: 12 hex digits, with `-dirty` where files were changed since.

    `unknown` in a copy without git's data, and where git is missing or refuses to answer.
    """
    stamp = Path(__file__).with_name(STAMP)
    if stamp.is_file():
        return stamp.read_text(encoding="ascii").strip()
    return commit_of(_CHECKOUT)


def commit_of(checkout: Path) -> str:
    """Return the commit of a checkout, as `commit` does.

    Parameters
    ----------
    checkout : the folder with `.git` itself; a folder somewhere in another project is none
    """
    # within a hook these would name another repository
    env = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    env["GIT_CEILING_DIRECTORIES"] = str(checkout.parent)  # a project around it is another one
    env["GIT_OPTIONAL_LOCKS"] = "0"  # a commit that is being made does not wait for this
    try:
        done = subprocess.run(
            ["git", "-C", str(checkout), "describe", "--always", "--dirty", "--abbrev=12",
             "--exclude=*"],
            env=env, capture_output=True, text=True, check=False, timeout=_GIT_WALL_S,
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired):
        return UNKNOWN
    return done.stdout.strip() if done.returncode == 0 else UNKNOWN


def software_versions() -> dict[str, str]:
    """Return versions by name, for journal and reports."""
    return {
        "cellctl": version("cellctl"),
        "commit": commit(),
        "python": sys.version.split()[0],
        "system": platform.platform(terse=True),
    }
