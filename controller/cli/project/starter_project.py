"""`cellctl init`: a new project from files that come with cellctl."""

import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from controller.config import EMULATED_CELL, SHIPPED

from ..inputs.checks import check_empty_folder
from ..terminal.output import emit, print_line

STARTER: Final = Path(__file__).parent / "starter"
RECIPE: Final = SHIPPED / "holder.yaml"
FILES: Final = {  # contents by file name in the project
    "README.md": STARTER / "README.md",
    "plan_part.py": STARTER / "plan_part.py",
    "parts/holder.stl": SHIPPED / "parts" / "holder.stl",
    "parts/LICENSE-trimesh": SHIPPED / "parts" / "LICENSE-trimesh",
}
RECIPE_HEAD: Final = """\
# What to inspect and how sharply. Files are named relative to this one and lie in its folder or
# below. `cellctl check` names what is wrong, with file and line.
"""
CELL_HEAD: Final = """\
# The cell of this project. Replace `emulated` by the address of each real device, one by one, and
# the positions by measured ones; `cellctl doctor` looks at the devices and moves nothing.
"""


def lay_out_project(folder: Path, *, as_json: bool) -> int:
    """Write a ready-to-run project into a new or empty folder; return the exit code.

    Raises
    ------
    ConfigError : the folder is not empty, is no folder, or cannot be written to
    """
    check_empty_folder(folder)
    (folder / "parts").mkdir(parents=True)
    recipe = RECIPE.read_text(encoding="utf-8").replace("cells/emulated.yaml", "cell.yaml")
    (folder / "recipe.yaml").write_text(RECIPE_HEAD + recipe, encoding="utf-8")
    cell = EMULATED_CELL.read_text(encoding="utf-8")
    (folder / "cell.yaml").write_text(CELL_HEAD + cell, encoding="utf-8")
    for name, source in FILES.items():
        shutil.copyfile(source, folder / name)
    tell_files(
        folder,
        ("recipe.yaml", "cell.yaml", *FILES),
        "cellctl check, cellctl plan, cellctl run --speed 10",
        as_json=as_json,
    )
    return 0


def tell_files(folder: Path, files: Iterable[str], next_steps: str, *, as_json: bool) -> None:
    """Print the files that were laid out.

    Parameters
    ----------
    folder : where they are
    files : their names in it
    next_steps : commands for a person to give there
    as_json : print one JSON object instead of lines
    """
    names = sorted(files)
    if as_json:
        emit({"event": "init", "folder": str(folder), "files": names})
        return
    for name in names:
        print_line(f"  {folder / name}")
    print_line(f"Next: cd {folder}, then {next_steps}")
