"""The parts that recognition and planning are measured with: which files, and what is in them."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

import trimesh
from bench import ROOT, SHARED

from controller.cad import StablePose, load_solid
from controller.cad.compiled import CompiledPart, part_name
from controller.config import is_cad_file


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


def planning_parts(names: Sequence[str] = ()) -> dict[str, Path]:
    """Return the CAD files by part, our own after the shared ones; all of them, or those named."""
    folders = [ROOT / "benchmarks" / "parts"]
    if (SHARED / "parts").is_dir():
        folders.insert(0, SHARED / "parts")
    else:
        print(f"the shared parts are left out: there is no {SHARED / 'parts'}", file=sys.stderr)
    found = cad_files(folders)
    unknown = [n for n in names if n not in found]
    if unknown:
        raise SystemExit(f"no part {', '.join(unknown)}; there are {', '.join(found)}")
    return {n: f for n, f in found.items() if not names or n in names}


def start_poses(part: CompiledPart) -> list[StablePose]:
    """Return the ways it may start lying: those that stay, and that a nudge does not tip."""
    return [p for p in part.poses if not p.rolling and not p.marginal]
