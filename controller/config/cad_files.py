"""Find CAD files by their names alone."""

from pathlib import Path
from typing import Final

CAD_FORMATS: Final = (".stl", ".obj", ".ply", ".off", ".3mf", ".step", ".stp", ".yaml")


def is_cad_file(path: Path) -> bool:
    """Return whether a file is a CAD file by its name; YAML counts only if named as CSG."""
    ending = path.suffix.lower()
    if ending == ".yaml":
        return path.name.lower().endswith(".csg.yaml")
    return ending in CAD_FORMATS
