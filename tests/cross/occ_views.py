"""Visible edges of a STEP part by the STEP kernel's exact hidden-line removal: the oracle.

Runs as a process of its own, since the kernel may crash or never come back:

python tests/cross/occ_views.py FILE.step VIEWS.npz OUT_FOLDER

VIEWS.npz holds ``R`` (n, 3, 3), CAD to upright, ``origin_mm`` (3,), which projects to (0, 0), and
``todo``, numbers of those to draw. Per view OUT_FOLDER gets ``<i>.npz``: ``points`` (p, 2) mm, at
most 0.02 mm apart along the visible lines, ``length_mm`` (p,), what each stands for, and ``kind``
(p,), a number of `KINDS`.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
SAME_MM = 1e-3
STEP_MM = 0.02  # well below the 0.05 mm that lines may be apart
KINDS = ("sharp", "outline", "smooth", "seam")  # seam: curvature and more go on across it


def draw(shape, R: Array, origin_mm: Array) -> dict[str, Array]:  # noqa: ANN001  kernel's type
    """Return the visible lines of a kernel's shape, sampled."""
    from OCP.BRepAdaptor import BRepAdaptor_Curve
    from OCP.BRepLib import BRepLib
    from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt
    from OCP.HLRAlgo import HLRAlgo_Projector
    from OCP.HLRBRep import HLRBRep_Algo, HLRBRep_HLRToShape
    from OCP.TopAbs import TopAbs_EDGE
    from OCP.TopExp import TopExp_Explorer
    from OCP.TopoDS import TopoDS

    algorithm = HLRBRep_Algo()
    algorithm.Add(shape)
    to_eye, right = gp_Dir(*map(float, R[2])), gp_Dir(*map(float, R[0]))
    algorithm.Projector(HLRAlgo_Projector(gp_Ax2(gp_Pnt(*map(float, origin_mm)), to_eye, right)))
    algorithm.Update()
    algorithm.Hide()
    drawn = HLRBRep_HLRToShape(algorithm)
    points, lengths, kinds = [], [], []
    sets = (
        drawn.VCompound(),
        drawn.OutLineVCompound(),
        drawn.Rg1LineVCompound(),
        drawn.RgNLineVCompound(),
    )
    for kind, compound in enumerate(sets):
        if compound is None or compound.IsNull():
            continue
        BRepLib.BuildCurves3d_s(compound)
        walk = TopExp_Explorer(compound, TopAbs_EDGE)
        while walk.More():
            curve = BRepAdaptor_Curve(TopoDS.Edge_s(walk.Current()))
            walk.Next()
            # fine in the parameter first, then equal steps along the length
            t = np.linspace(curve.FirstParameter(), curve.LastParameter(), 1025)
            fine = np.array([(p.X(), p.Y()) for p in (curve.Value(float(x)) for x in t)])
            along = np.concatenate(
                [[0.0], np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1))]
            )
            count = max(int(np.ceil(along[-1] / STEP_MM)), 1)
            # the middles of equal pieces, so that each point stands for an equal length
            at = (np.arange(count) + 0.5) / count * along[-1]
            points.append(np.column_stack([np.interp(at, along, fine[:, k]) for k in (0, 1)]))
            lengths.append(np.full(count, along[-1] / count))
            kinds.append(np.full(count, kind))
    if not points:
        points, lengths, kinds = [np.zeros((0, 2))], [np.zeros(0)], [np.zeros(0, int)]
    return {
        "points": np.concatenate(points),
        "length_mm": np.concatenate(lengths),
        "kind": np.concatenate(kinds),
    }


def know_seams(shape) -> None:  # noqa: ANN001  kernel's type
    """Let seams between two pieces of one ball be seams: some files have them as mere tangents."""
    from OCP.BRep import BRep_Builder
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.GeomAbs import GeomAbs_CN, GeomAbs_Sphere
    from OCP.TopAbs import TopAbs_EDGE, TopAbs_FACE
    from OCP.TopExp import TopExp
    from OCP.TopoDS import TopoDS
    from OCP.TopTools import TopTools_IndexedDataMapOfShapeListOfShape

    faces_at = TopTools_IndexedDataMapOfShapeListOfShape()
    TopExp.MapShapesAndAncestors_s(shape, TopAbs_EDGE, TopAbs_FACE, faces_at)
    for i in range(1, faces_at.Extent() + 1):
        faces = [TopoDS.Face_s(face) for face in faces_at.FindFromIndex(i)]
        surfaces = [BRepAdaptor_Surface(face) for face in faces]
        if len(faces) == 2 and all(s.GetType() == GeomAbs_Sphere for s in surfaces):
            one, other = (s.Sphere() for s in surfaces)
            apart_mm = one.Location().Distance(other.Location())
            if apart_mm < SAME_MM and abs(one.Radius() - other.Radius()) < SAME_MM:
                edge = TopoDS.Edge_s(faces_at.FindKey(i))
                BRep_Builder().Continuity(edge, *faces, GeomAbs_CN)


def ask(file: Path, R: Array, origin_mm: Array, timeout_s: float) -> list[dict[str, Array] | None]:
    """Return what the kernel draws for each ``R`` (n, 3, 3); None where it crashed or hung."""
    with tempfile.TemporaryDirectory(prefix="occ-views-") as name:
        folder = Path(name)
        todo = list(range(len(R)))
        while todo:
            np.savez(folder / "views.npz", R=R, origin_mm=origin_mm, todo=todo)
            command = [sys.executable, __file__, str(file), str(folder / "views.npz"), name]
            process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
            since = time.monotonic()
            while process.poll() is None and time.monotonic() - since < timeout_s:
                time.sleep(0.05)
                while todo and (folder / f"{todo[0]}.npz").exists():
                    todo.pop(0)
                    since = time.monotonic()
            if process.poll() is None:
                process.kill()
            process.wait()
            while todo and (folder / f"{todo[0]}.npz").exists():
                todo.pop(0)
            if todo:
                todo.pop(0)  # the view it died on; the next process goes on after it
        drawn: list[dict[str, Array] | None] = []
        for i in range(len(R)):
            path = folder / f"{i}.npz"
            if path.exists():
                with np.load(path) as arrays:
                    drawn.append({k: arrays[k] for k in arrays.files})
            else:
                drawn.append(None)
        return drawn


def main() -> int:
    """Draw all views asked for, one file each as soon as it is done."""
    from OCP.STEPControl import STEPControl_Reader
    from OCP.TopAbs import TopAbs_SOLID
    from OCP.TopExp import TopExp_Explorer

    file, views, folder = sys.argv[1:]
    reader = STEPControl_Reader()
    reader.ReadFile(file)
    reader.TransferRoots()
    # the body alone: construction lines and drawing frames are shapes to the kernel too
    walk = TopExp_Explorer(reader.OneShape(), TopAbs_SOLID)
    shape = walk.Current()
    know_seams(shape)
    asked = np.load(views)
    for i in asked["todo"]:
        arrays = draw(shape, asked["R"][i], asked["origin_mm"])
        part = Path(folder) / f"{i}.part"
        with part.open("wb") as sink:
            np.savez(sink, **arrays)
        part.rename(Path(folder) / f"{i}.npz")
    return 0


if __name__ == "__main__":
    sys.exit(main())
