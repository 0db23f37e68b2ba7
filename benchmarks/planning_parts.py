"""The parts that planning is measured with: the shared CAD files and our own CSG parts."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from bench import ROOT, SHARED
from recognition_parts import cad_files

from controller.cad import StablePose
from controller.cad.compiled import CompiledPart, load_part

CSG_PARTS = ROOT / "benchmarks" / "parts"


def planning_parts(names: Sequence[str] = ()) -> dict[str, Path]:
    """Return the CAD files by part, our own after the shared ones; all of them, or those named."""
    folders = [CSG_PARTS]
    if (SHARED / "parts").is_dir():
        folders.insert(0, SHARED / "parts")
    else:
        print(f"the shared parts are left out: there is no {SHARED / 'parts'}", file=sys.stderr)
    found = cad_files(folders)
    unknown = [n for n in names if n not in found]
    if unknown:
        raise SystemExit(f"no part {', '.join(unknown)}; there are {', '.join(found)}")
    return {n: f for n, f in found.items() if not names or n in names}


def read_part(path: Path) -> CompiledPart:
    """Return a part with its samples and the ways it lies, from the cache where it is there."""
    return load_part(path)


def start_poses(part: CompiledPart) -> list[StablePose]:
    """Return the ways it may start lying: those that stay, and that a nudge does not tip."""
    return [p for p in part.poses if not p.rolling and not p.marginal]
