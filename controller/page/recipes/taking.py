"""A CAD file that a person has sent: looked at by a child process, then part and recipe written."""

from __future__ import annotations

import re
import shutil
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from controller.cad.compiled import UNITLESS
from controller.config import ConfigError, is_cell_file, load_recipe, yaml_tree
from controller.config.cad_files import body_name, body_path
from controller.config.files import file_sha256
from controller.config.new_recipe import new_recipe
from controller.config.shipped import PROJECT_CELL, PROJECT_PARTS

STEM: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,59}")


@dataclass(frozen=True, slots=True)
class Staged:
    """A file that was sent and is not part of the project yet.

    Attributes
    ----------
    path : path of the file, under its final name
    sha256 : SHA-256 of its bytes
    unit : unit of its lengths, where its format names none
    body : body of a STEP file with several; empty for its only one
    """

    path: Path
    sha256: str
    unit: str = "mm"
    body: str = ""

    @property
    def is_unitless(self) -> bool:
        """Whether its format names no unit."""
        return self.path.suffix.lower() in UNITLESS

    @property
    def part(self) -> Path:
        """The part, as `cellctl` takes it."""
        return body_path(self.path, self.body) if self.body else self.path

    @property
    def mark(self) -> str:
        """Changes with each result of the work on the file."""
        return f"{self.sha256} {self.unit} {self.body}"

    def with_choice(self, unit: str, body: str) -> Staged:
        """Return the same file with another unit or body.

        Parameters
        ----------
        unit : unit of its lengths
        body : of several
        """
        return replace(self, unit=unit, body=body_name(body))

    def arguments(self, folder: Path) -> tuple[str, ...]:
        """Return the arguments of `cellctl` for it; drawings go into a folder."""
        unit = ("--unit", self.unit) if self.is_unitless else ()
        return ("compile", str(self.part), *unit, "--json", "--drawings", str(folder))


class UploadStage:
    """Keeps the last uploaded file until it is taken or another one comes."""

    def __init__(self) -> None:
        self.file: Staged | None = None
        self._folder: Path | None = None

    def put(self, name: str, path: Path) -> Staged:
        """Keep a file that was sent, in place of the one before; return it.

        Parameters
        ----------
        name : name of the file, without folders
        path : path of its bytes for now
        """
        self.clear()
        self._folder = Path(tempfile.mkdtemp(prefix="cellctl-sent-"))
        kept = self._folder / name
        shutil.copyfile(path, kept)
        self.file = Staged(kept, file_sha256(kept))
        return self.file

    def clear(self) -> None:
        """Forget the file."""
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)
        self.file, self._folder = None, None


def take(staged: Staged, project: Path, stem: str) -> Path:
    """Write part and recipe into the project; return the recipe's file.

    Existing files are never overwritten: a part's file of the same name must have the same content.

    Parameters
    ----------
    staged : the part
    project : folder of the recipes
    stem : name of the recipe

    Raises
    ------
    ConfigError : the name is not allowed or taken, or a file cannot be written
    """
    if not STEM.fullmatch(stem):
        raise ConfigError("a recipe's name has letters, digits, `-` and `_`, 60 at most")
    recipe = project / f"{stem}.yaml"
    text = new_recipe(
        stem,
        f"{PROJECT_PARTS}/{staged.part.name}",
        unit=staged.unit if staged.is_unitless else None,
        cell=PROJECT_CELL if _has_cell(project) else None,
    )
    part = project / PROJECT_PARTS / staged.path.name
    try:
        is_new = _put_part(staged, part)
    except OSError as error:
        raise ConfigError(f"{part.name}: cannot be written: {error.strerror or error}") from error
    try:
        load_recipe(recipe, text)
        with recipe.open("x", encoding="utf-8") as file:
            file.write(text)
    except (OSError, ConfigError) as error:
        if is_new:
            part.unlink(missing_ok=True)
        if isinstance(error, FileExistsError):
            raise ConfigError(f"{recipe.name}: is there already; choose another name") from error
        if isinstance(error, OSError):
            reason = error.strerror or error
            raise ConfigError(f"{recipe.name}: cannot be written: {reason}") from error
        raise
    return recipe


def _put_part(staged: Staged, part: Path) -> bool:
    """Write a part's file; return whether it was not there before."""
    part.parent.mkdir(exist_ok=True)
    if not part.parent.resolve().is_relative_to(part.parent.parent.resolve()):
        raise ConfigError(f"{part.parent.name} is a link that leads out of the project")
    try:
        with part.open("xb") as written, staged.path.open("rb") as kept:
            shutil.copyfileobj(kept, written)
    except FileExistsError:
        if file_sha256(part) != staged.sha256:
            raise ConfigError(
                f"{PROJECT_PARTS}/{part.name} is there already and is another file; rename yours"
            ) from None
        return False
    return True


def _has_cell(project: Path) -> bool:
    path = project / PROJECT_CELL
    try:
        return path.is_file() and is_cell_file(yaml_tree(path))
    except ConfigError:
        return False
