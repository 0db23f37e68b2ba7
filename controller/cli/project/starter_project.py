"""`cellctl init`: a new project from a CAD file, or from the part that comes with cellctl."""

import json
import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from controller.cad.compiled import UNITLESS
from controller.cad.reading import files_of, load_solid
from controller.config import EMULATED_CELL, SHIPPED, ConfigError, load_recipe, split_cad
from controller.config.new_recipe import new_recipe
from controller.config.shipped import PROJECT_CELL, PROJECT_PARTS, PROJECT_RECIPE

from ..inputs.checks import check_empty_folder, require_files
from ..terminal.output import emit, print_line

STARTER: Final = Path(__file__).parent / "starter"
OUR_RECIPE: Final = SHIPPED / "holder.yaml"
OUR_LICENCE: Final = "LICENSE-trimesh"  # beside its part
CELL_HEAD: Final = """\
# The cell of this project. Replace `emulated` by the address of each real device, one by one, and
# the positions by measured ones; `cellctl doctor` looks at the devices and moves nothing.
"""
OUR_ROWS: Final = """\
| `parts/holder.stl` | the part: `models/rod.3DXML`, body "holder", of github.com/mikedh/trimesh |
| `parts/LICENSE-trimesh` | its licence (MIT) |"""


@dataclass(frozen=True, slots=True)
class StarterPart:
    """The part of a new project.

    Attributes
    ----------
    path : CAD file; ``file.step#NAME`` is one body of a file of several
    unit : unit of its lengths, for a format that names none
    density_g_cm3 : of its material, if it is known
    beside : further files of its folder
    """

    path: Path
    unit: str | None = None
    density_g_cm3: float | None = None
    beside: tuple[Path, ...] = ()

    @property
    def files(self) -> dict[str, Path]:
        """Its files by their names in the project."""
        files = (*files_of(self.path), *self.beside)
        folder = files[0].parent
        return {f"{PROJECT_PARTS}/{one.relative_to(folder).as_posix()}": one for one in files}


def our_part() -> StarterPart:
    """Return the part that comes with cellctl, as its recipe has it."""
    ours = load_recipe(OUR_RECIPE)
    licence = ours.part.with_name(OUR_LICENCE)
    return StarterPart(ours.part, ours.unit, ours.density_g_cm3, (licence,))


def lay_out_project(folder: Path, part: StarterPart | None, *, as_json: bool) -> int:
    """Write a ready-to-run project into a new or empty folder; return the exit code.

    Parameters
    ----------
    folder : new or empty
    part : the part; None for the one that comes with cellctl
    as_json : print one JSON object instead of lines

    Raises
    ------
    CadError : the part cannot be read
    ConfigError : the folder is not empty, is no folder, or cannot be written to; no such part
    """
    check_empty_folder(folder)
    if part is not None:
        require_files([part.path])
        load_solid(part.path, unit=part.unit)
    used = part or our_part()
    source = split_cad(used.path)
    name, files = source.part_name, used.files
    recipe = new_recipe(
        name,
        f"{PROJECT_PARTS}/{source.name}",
        unit=(used.unit or "mm") if source.ending in UNITLESS else None,
        density_g_cm3=used.density_g_cm3,
        cell=PROJECT_CELL,
    )
    readme = (STARTER / "README.md").read_text(encoding="utf-8")
    rows = OUR_ROWS if part is None else f"| `{PROJECT_PARTS}/{source.file.name}` | the part |"
    script = (STARTER / "plan_part.py").read_text(encoding="utf-8")
    texts = {
        PROJECT_RECIPE.name: recipe,
        PROJECT_CELL: CELL_HEAD + EMULATED_CELL.read_text(encoding="utf-8"),
        "README.md": readme.format(part_rows=rows),
        "plan_part.py": script.replace('"holder.stl"', json.dumps(source.name)),
    }
    try:
        for file, path in files.items():
            (folder / file).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, folder / file)
        for file, text in texts.items():
            (folder / file).write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{folder}: cannot be written: {error.strerror or error}") from error
    load_recipe(folder / PROJECT_RECIPE)
    steps = "cellctl check, cellctl plan, cellctl run --speed 10"
    tell_files(folder, (*texts, *files), steps, as_json=as_json)
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
