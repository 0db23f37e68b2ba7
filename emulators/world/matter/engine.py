"""The physics engine of the emulated world, pybullet: loaded once a world needs it.

A cell of real devices needs none, and not every Python has a wheel of it (pyproject.toml).
"""

import sys
from typing import Any, Final

# pybullet has wheels up to Python 3.11; its fork, imported by the same name, has newer ones
PACKAGE: Final = "pybullet" if sys.version_info < (3, 12) else "pybullet-arm64"


class EngineError(Exception):
    """The engine is not installed."""


def load_engine() -> Any:  # noqa: ANN401 - a module without types
    """Return the module `pybullet`.

    Raises
    ------
    EngineError : it is not installed
    """
    try:
        import pybullet
    except ImportError as error:
        raise EngineError(
            f"the emulated cell needs the library pybullet ({error}): pip install {PACKAGE}; "
            "a cell of real devices needs none"
        ) from error
    return pybullet
