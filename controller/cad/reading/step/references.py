"""Other files to which a STEP file refers for parts of its product structure.

Facts: ISO 10303-21 for the text; the names are in DOCUMENT_FILE and in
APPLIED_EXTERNAL_IDENTIFICATION_ASSIGNMENT (recommended practices of the CAx-IF for external
references). The kernel resolves names from the file's own folder.
"""

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Final

from controller.config.cad_files import STEP_FORMATS, split_cad

from ...errors import LargeCadError, UnreadableCadError
from .._ahead import read_file

NAMED: Final = re.compile(
    rb"(?:DOCUMENT_FILE|APPLIED_EXTERNAL_IDENTIFICATION_ASSIGNMENT)\s*\(\s*'((?:[^']|'')*)'"
)
WIDE: Final = re.compile(r"\\X2\\((?:[0-9A-Fa-f]{4})*)\\X0\\")
NARROW: Final = re.compile(r"\\X\\([0-9A-Fa-f]{2})")
MAX_FILE_COUNT: Final = 1000
MAX_BYTES: Final = 2**30


@dataclass(frozen=True, slots=True)
class References:
    """The files that a STEP file is made of.

    Attributes
    ----------
    found : content by name as from the folder of the first, which is the file itself
    missing : names that lead to no file
    """

    found: dict[str, bytes]
    missing: tuple[str, ...]


def referred(data: bytes) -> list[str]:
    """Return the STEP files named in a STEP text, each once, without drawings and the like."""
    if b"DOCUMENT_FILE" not in data and b"EXTERNAL_IDENTIFICATION" not in data:
        return []
    names = (decoded(match[1]) for match in NAMED.finditer(data))
    return [name for name in dict.fromkeys(names) if name.lower().endswith(STEP_FORMATS)]


def decoded(text: bytes) -> str:
    r"""Return a text of a STEP file without the escapes ``''``, ``\X\hh``, ``\X2\hhhh..\X0\``."""
    plain = text.decode("utf-8", "replace").replace("''", "'")
    plain = WIDE.sub(lambda found: bytes.fromhex(found[1]).decode("utf-16-be", "replace"), plain)
    return NARROW.sub(lambda found: chr(int(found[1], 16)), plain).replace("\\\\", "\\")


def collect(path: Path, data: bytes) -> References:
    """Return a STEP file with all files that it names, and that those name.

    A name that leads out of the folder counts as missing, so that a file received by mail cannot
    have any other file read.

    Parameters
    ----------
    path : path of the file
    data : its content

    Raises
    ------
    LargeCadError : more files or bytes than are read
    UnreadableCadError : the system does not give one of them
    """
    found, missing = {path.name: data}, []
    todo = [(PurePosixPath(), name) for name in referred(data)]
    total = len(data)
    while todo:
        folder, name = todo.pop(0)
        inside = folder / name.replace("\\", "/")
        if str(inside) in found or str(inside) in missing:
            continue
        if not is_there(path.parent, inside):
            missing.append(str(inside))
            continue
        if len(found) >= MAX_FILE_COUNT:
            raise LargeCadError(f"{path}: names more than {MAX_FILE_COUNT} other files")
        content = read_file(path.parent / inside)
        total += len(content)
        if total > MAX_BYTES:
            raise LargeCadError(
                f"{path}: with the files it names, more than {MAX_BYTES / 1e9:.0f} GB"
            )
        found[str(inside)] = content
        todo += [(inside.parent, other) for other in referred(content)]
    return References(found, tuple(missing))


def is_there(folder: Path, name: PurePosixPath) -> bool:
    """Return True if a name leads to a file in a folder or below it."""
    if name.is_absolute() or ".." in name.parts or (name.parts and ":" in name.parts[0]):
        return False
    try:
        file = (folder / name).resolve()
        return file.is_file() and file.is_relative_to(folder.resolve())
    except (OSError, RuntimeError, ValueError):
        return False


def files_of(path: Path) -> tuple[Path, ...]:
    """Return the file of a part and all files that it names, for copying.

    Parameters
    ----------
    path : a part's name, with that of its body or without; a file that cannot be read stands alone
    """
    file = split_cad(path).file
    names = list(_made_of(file) or ())
    return (file, *(file.parent / name for name in names[1:]))


def digests_of(path: Path) -> tuple[str, ...]:
    """Return the SHA-256 of each of `files_of`, every file read once.

    Parameters
    ----------
    path : as `files_of`

    Raises
    ------
    OSError : the system does not give the file
    """
    file = split_cad(path).file
    contents = _made_of(file)
    if contents is not None:
        return tuple(hashlib.sha256(data).hexdigest() for data in contents.values())
    with file.open("rb") as alone:
        return (hashlib.file_digest(alone, "sha256").hexdigest(),)


def _made_of(file: Path) -> Mapping[str, bytes] | None:
    """Return the content of a STEP file and of its references, None for any other file."""
    if file.suffix.lower() not in STEP_FORMATS:
        return None
    try:
        return collect(file, read_file(file)).found
    except (LargeCadError, UnreadableCadError):
        return None
