"""What a 3MF package holds, looked at before it is unpacked: how much, and in which unit."""

import io
import zipfile
from pathlib import Path
from typing import Final

from lxml import etree

from ..errors import LargeCadError, UnreadableCadError
from ..solid import check_count
from .units import read_unit

MAX_BYTES: Final = 400_000_000  # two million triangles and their corners take 250 MB of XML
MAX_COMPONENTS: Final = 16  # each may hold others twice: more of them unfold without end
CHUNK_BYTES: Final = 1 << 20
DEFAULT_UNIT: Final = "millimeter"  # 3MF core specification 3.4


def check_3mf(data: bytes, path: Path) -> str:
    """Return the unit a 3MF file is in, as `read_unit` names it.

    Raises
    ------
    UnreadableCadError : no package, damaged, without a model, or an assembly
    LargeCadError : unpacks to more than is read
    UnitCadError : a unit nobody knows
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as package:
            unpacked = sum(entry.file_size for entry in package.infolist())
            if unpacked > MAX_BYTES:
                raise LargeCadError(
                    f"{path}: unpacks to {unpacked / 1e6:,.0f} MB, the most is "
                    f"{MAX_BYTES / 1e6:,.0f} MB; export it with a coarser chord error"
                )
            models = [n for n in package.namelist() if n.lower().endswith(".model")]
            for name in models:
                _look_through(package, name, path)
            main = next((n for n in models if "3d/3dmodel.model" in n.lower()), None)
            if main is None:
                raise UnreadableCadError(f"{path}: holds no 3D model; export it again")
            with package.open(main) as model:
                _, root = next(etree.iterparse(model, events=("start",), resolve_entities=False))
            unit = root.get("unit", DEFAULT_UNIT)
    except (UnreadableCadError, LargeCadError):
        raise
    except Exception as error:
        reason = " ".join(str(error).split())
        raise UnreadableCadError(
            f"{path}: is not a whole 3MF package ({type(error).__name__}: {reason:.200}); "
            "copy or export it again"
        ) from error
    return read_unit(str(unit), path)[0]


def _look_through(package: zipfile.ZipFile, name: str, path: Path) -> None:
    triangles = components = 0
    tail = b""
    with package.open(name) as model:
        while chunk := model.read(CHUNK_BYTES):
            text = tail + chunk
            triangles += text.count(b"triangle ") - tail.count(b"triangle ")
            components += text.count(b"component ") - tail.count(b"component ")
            tail = text[-16:]
            check_count(triangles, str(path))
    if components > MAX_COMPONENTS:
        raise UnreadableCadError(
            f"{path}: is an assembly of {components} components; export the part alone"
        )
