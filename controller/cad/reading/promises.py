"""Check of a mesh file's header against the file's size, before the file is read."""

from collections.abc import Mapping
from pathlib import Path

from ..errors import UnreadableCadError
from ..solid import check_count


def check_promises(promised: Mapping[str, int], size: int, path: Path) -> None:
    """Refuse a header that states more than the file has bytes for, or more than is read.

    Parameters
    ----------
    promised : promised counts; ``triangles`` are counted
    size : size of the file [bytes]
    path : path of the file, for messages

    Raises
    ------
    UnreadableCadError : more than the bytes can hold
    LargeCadError : more triangles than a part is worth
    """
    for kind, count in promised.items():
        if 3 * count > size:  # three coordinates or corners at a byte each, and no reader reserves
            raise UnreadableCadError(
                f"{path}: promises {count:,} {kind} and is {size:,} bytes long; "
                "copy or export it again"
            )
    check_count(promised.get("triangles", 0), str(path))
