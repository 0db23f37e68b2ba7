"""Build what a release consists of: sdist and wheel, from a clean copy of a checkout.

    python packaging/release.py dist

The wheel is built from the sdist, so that the sdist is known to be complete. Both name the commit
(`setup.py`). No network: the setuptools of this environment builds (`pip install -e '.[test]'`).
"""

from __future__ import annotations

import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def build(source: Path, out: Path) -> tuple[Path, Path]:
    """Build sdist and wheel.

    Parameters
    ----------
    source : a checkout, or a copy of one; setuptools leaves `*.egg-info` in it
    out : folder for both files

    Raises
    ------
    RuntimeError : with what setuptools printed
    """
    sdist = out / _setuptools("sdist", source, out)
    with tempfile.TemporaryDirectory() as scratch:
        with tarfile.open(sdist) as archive:
            archive.extractall(scratch, filter="data")
        (unpacked,) = Path(scratch).iterdir()
        wheel = out / _setuptools("wheel", unpacked, out)
    return sdist, wheel


def _setuptools(what: str, source: Path, out: Path) -> str:
    """Build with setuptools in a process of its own; returns the file's name."""
    script = (
        "import sys; from setuptools import build_meta;"
        f"print('\\n' + build_meta.build_{what}(sys.argv[1]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(out.resolve())],
        cwd=source, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode != 0:
        raise RuntimeError(f"{what} of {source}:\n{done.stdout}{done.stderr}")
    return done.stdout.splitlines()[-1]
