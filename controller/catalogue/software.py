"""The software that computes here, down to the source: what two processes must have in common."""

import platform
from functools import cache
from pathlib import Path
from typing import Final

from controller.cache import digest_of, source_hash, versions
from controller.setup.software import installed_version

# Libraries whose results are part of ours: another version of one may give other last digits.
DECIDING: Final = (
    *("numpy", "scipy", "opencv-python-headless", "shapely", "trimesh", "manifold3d", "embreex"),
    *("python-fcl", "rtree", "cadquery-ocp-novtk"),
)
DIGITS: Final = 12  # of a hash, for people: as many as of a commit


@cache
def software_here() -> dict[str, str]:
    """Return the versions by name: of cellctl, its source, Python, and the deciding libraries."""
    return {
        "cellctl": installed_version(),
        "source": source_hash(Path(__file__).parents[1])[:DIGITS],
        "Python": platform.python_version(),
        **dict(zip(DECIDING, versions(*DECIDING), strict=True)),
    }


def software_key() -> str:
    """Return the version of cellctl with a hash of all of `software_here`."""
    here = software_here()
    return f"{here['cellctl']} {digest_of(here)[:DIGITS]}"


def why_other(theirs: object) -> str:
    """Return how other software differs from this one, in words; empty if it does not.

    Parameters
    ----------
    theirs : what `software_here` returned there, or the error instead
    """
    if not isinstance(theirs, dict):
        return f"has no such cellctl ({type(theirs).__name__}: {theirs})"
    here = software_here()
    names = [name for name in (*here, *theirs) if here.get(name) != theirs.get(name)]
    return "; ".join(
        f"has {name} {theirs.get(name, 'none')}, this process {here.get(name, 'none')}"
        for name in dict.fromkeys(names)
    )
