"""Find the files of cellctl itself (recipes, parts, the emulated cell), and a project's recipe.

The folder `recipes` lies beside the package `controller`, in a checkout as in site-packages
(ADR 112), so that every command works in any folder.
"""

from pathlib import Path
from typing import Final

from .errors import ConfigError

SHIPPED: Final = Path(__file__).resolve().parents[2] / "recipes"
EMULATED_CELL: Final = SHIPPED / "cells" / "emulated.yaml"
DEFAULT_RECIPE: Final = SHIPPED / "featuretype.yaml"
# As `cellctl init` names them.
PROJECT_RECIPE: Final = Path("recipe.yaml")
PROJECT_CELL: Final = "cell.yaml"
PROJECT_PARTS: Final = "parts"


def shipped_recipes() -> list[str]:
    """Return the names of the recipes that come with cellctl."""
    return sorted(path.stem for path in SHIPPED.glob("*.yaml"))


def project_recipe() -> Path | None:
    """Return the recipe of the working directory, None if there is none."""
    return PROJECT_RECIPE if PROJECT_RECIPE.is_file() else None


def find_recipe(name: Path | None) -> Path:
    """Return the recipe file that a command line means.

    Parameters
    ----------
    name : a file, or the bare name of a recipe that comes with cellctl (default: the project's
        recipe, else the default one)

    Raises
    ------
    ConfigError : a bare name of neither
    """
    if name is None:
        return project_recipe() or DEFAULT_RECIPE
    if name.suffix or len(name.parts) != 1 or _may_be_there(name):
        return name
    known = shipped_recipes()
    if name.name not in known:
        raise ConfigError(
            f"{name}: no such file, and no recipe of this name comes with cellctl; these do: "
            f"{', '.join(known)}"
        )
    return SHIPPED / f"{name}.yaml"


def _may_be_there(name: Path) -> bool:
    """Return whether a name may be a file, so that reading it reports its faults."""
    try:
        return name.exists()
    except (OSError, ValueError):
        return True
