"""CAD files by their names alone; ``file.step#NAME`` is one body of several in a file.

Code that only passes such a name on treats it as any path. Code that opens, hashes or copies the
file splits the name by `split_cad`.
"""

import unicodedata
from dataclasses import dataclass
from pathlib import Path
from typing import Final

CAD_FORMATS: Final = (".stl", ".obj", ".ply", ".off", ".3mf", ".step", ".stp", ".yaml")
STEP_FORMATS: Final = (".step", ".stp")
MAX_CAD_BYTES: Final = 2**30  # size of a file above which it is not read
MARK: Final = "#"  # separator between the file and the name of the body
EVERY: Final = "*"  # in place of the name: all bodies, united


@dataclass(frozen=True, slots=True)
class CadSource:
    """The meaning of a part's name.

    Attributes
    ----------
    file : on the disk
    body : name of one of its bodies, as `body_name` has it, maybe empty, or `EVERY`; None where
        none is named
    """

    file: Path
    body: str | None = None

    @property
    def ending(self) -> str:
        """Of the file's name, in lower case with the dot."""
        return self.file.suffix.lower()

    @property
    def name(self) -> str:
        """The file's name without folders, with the body's."""
        return self.file.name if self.body is None else f"{self.file.name}{MARK}{self.body}"

    @property
    def part_name(self) -> str:
        """The part's name."""
        if self.body and self.body != EVERY:
            return self.body
        stem = readable(self.file.stem)
        return stem.removesuffix(".csg") if self.ending == ".yaml" else stem


def split_cad(path: Path) -> CadSource:
    """Return the file and the body that a part's name stands for.

    A file with the whole name is that file, whatever characters the name has. Otherwise the name
    ends with the first CAD file in it that is followed by `MARK`, an existing one before others.

    Parameters
    ----------
    path : ``file.step``, or ``file.step#NAME``
    """
    text = str(path)
    if MARK not in text or _is_file(path):
        return CadSource(path)
    marks = [i for i, sign in enumerate(text) if sign == MARK]
    cuts = [i for i in marks if text[:i].lower().endswith(CAD_FORMATS)]
    if not cuts:
        return CadSource(path)
    cut = next((i for i in cuts if _is_file(Path(text[:i]))), cuts[0])
    return CadSource(Path(text[:cut]), body_name(text[cut + 1 :]))


def cad_identity(name: str, sha256: str) -> str:
    """Return the identity of a product: the hash of its CAD file, and its body.

    Parameters
    ----------
    name : name of the part, ``file.step#NAME`` or without a body, as `CadSource.name` has it
    sha256 : SHA-256 of the file; empty if it is not known
    """
    body = split_cad(Path(name)).body
    return sha256 if body is None or not sha256 else f"{sha256}{MARK}{body}"


def body_path(file: Path, body: str) -> Path:
    """Return the name of a part that is one body of a file."""
    return file.with_name(f"{file.name}{MARK}{body}")


def body_name(text: str) -> str:
    """Return a body's name as written behind `MARK`: fit for a file's name.

    Parameters
    ----------
    text : text from a file, or from a person who names the body
    """
    spelt = unicodedata.normalize("NFC", text)
    signs = ("_" if c in "/\\" or not (c.isprintable() or c.isspace()) else c for c in spelt)
    return " ".join("".join(signs).split())


def readable(name: str) -> str:
    r"""Return a file's name as text: a byte that is no UTF-8 becomes ``\\xNN``.

    Such a name opens its file, but cannot be written into any text.
    """
    return name.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")


def is_cad_file(path: Path) -> bool:
    """Return whether a file is a CAD file by its name; YAML counts only if named as CSG."""
    ending = path.suffix.lower()
    if ending == ".yaml":
        return path.name.lower().endswith(".csg.yaml")
    return ending in CAD_FORMATS


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False
