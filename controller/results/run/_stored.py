"""What the rows of a run tell of its files: their hashes, and where there are copies."""

from collections.abc import Sequence

from controller.cell.journal import Row, is_of, rows

from .model import Copy


def stored_files(found: Sequence[Row]) -> dict[str, tuple[str, int]]:
    """Return each file's last SHA-256 in the journal, and the number of its row."""
    stored: dict[str, tuple[str, int]] = {}
    for row in found:
        if is_of(row, rows.FilesStored):
            for file, digest in row.body.items():
                stored[str(file)] = (str(digest), row.seq)
    return stored


def copies_in(found: Sequence[Row]) -> dict[str, Copy]:
    """Return the last copy of each picture that a run's rows name, by file."""
    copies: dict[str, Copy] = {}
    for row in found:
        if is_of(row, rows.PicturesCopied):
            body = rows.PicturesCopied.model_validate(row.body)
            copies |= {file: Copy(body.to, digest) for file, digest in body.files.items()}
    return copies
