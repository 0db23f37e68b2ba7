"""The parts that recognition is measured with: which files, and the surface in them."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

import trimesh

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from controller.cad import load_solid  # noqa: E402  (path set above)
from controller.cad.compiled import part_name  # noqa: E402
from controller.config import is_cad_file  # noqa: E402


def cad_files(paths: Iterable[Path]) -> dict[str, Path]:
    """Return the CAD files among files and folders, by part; the mesh where there are two."""
    found: dict[str, Path] = {}
    for path in paths:
        files = sorted(f for f in path.iterdir() if is_cad_file(f)) if path.is_dir() else [path]
        for file in files:
            if part_name(file) not in found or file.suffix.lower() == ".stl":
                found[part_name(file)] = file
    return found


def read_mesh(file: Path) -> trimesh.Trimesh:
    """Return the surface [mm] of a CAD file; an STL file is read by trimesh, as it stands."""
    if file.suffix.lower() == ".stl":
        mesh = trimesh.load(file, force="mesh")
        assert isinstance(mesh, trimesh.Trimesh)
        return mesh
    return load_solid(file).mesh
