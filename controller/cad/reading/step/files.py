"""STEP files: the solid with the file's exact surfaces, and its semantic tolerances.

The kernel works in a child process (`controller.step_kernel`). Here its arrays become a
`Solid`: one face of ours per surface, largest first, however many faces the file cuts it into. The
mesh is for the rooms that look at triangles; volume, centroid, areas, axes and radii are the
kernel's exact ones.
"""

import hashlib
import re
import tempfile
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import trimesh

from controller.arrays import FloatArray, IntArray
from controller.config.cad_files import EVERY, CadSource, body_path

from ...boundary import Face, FaceKind, turn_of
from ...errors import (
    CadError,
    EmptyCadError,
    InsideOutCadError,
    ManySolidsCadError,
    OpenCadError,
    SelfIntersectingCadError,
    UnreadableCadError,
)
from ...solid import Solid, make_solid
from ...surfaces.tolerances import Tolerance
from ._tolerances import tolerances_from
from .bodies import Bodies, StepBody, open_bodies
from .choosing import choose, many, require_one
from .kernel import KernelLimits, KernelRun, check_installed
from .merging import merge_faces
from .references import References, collect
from .texts import CODE_PAGE_TEXT, check_numbers, for_kernel
from .uniting import require_whole, touching_text, unite

# Tessellations tried in turn until the result is a closed surface: chord error as a multiple of the
# usual one for the part's size, angle [rad], repair before it. The kernel folds some sound blends
# at one fineness and not at another, hence two.
TESSELLATIONS: Final = (
    (1.0, 0.3, 0),
    (2.0, 0.3, 0),
    (1.0, 0.3, 2),
    (1.0, 0.3, 1),
)
CHANGED: Final = {
    "1": "Its surfaces do not close as they stand in the file; the STEP kernel mended them. "
    "Compare the part with its drawing, or export it again.",
    "2": "The STEP kernel misreads borders of its surfaces; they were worked out anew from their "
    "edges. Compare the part with its drawing, or export it again.",
}
MESH_SHARE: Final = 0.02  # a sound tessellation misses less of the volume by far
KINDS: Final[tuple[FaceKind, ...]] = ("plane", "cylinder", "cone", "sphere", "torus", "freeform")
# Units as ISO 10303-41 and the kernel spell them; the kernel converts even where it names none.
UNITS: Final = {
    "millimetre": "mm",
    "centimetre": "cm",
    "metre": "m",
    "inch": "inch",
    "foot": "foot",
}
# A file with tolerances has at least one of these words; other files need no second run.
SEMANTIC: Final = re.compile(
    rb"DIMENSIONAL_SIZE|DIMENSIONAL_LOCATION|GEOMETRIC_TOLERANCE|_TOLERANCE\(|[=\s]DATUM\s*\("
)
BEGIN, END = b"ISO-10303-21", b"END-ISO-10303-21"


@dataclass(frozen=True, eq=False, slots=True)
class StepEdges:
    """The edges of a STEP file, e of them.

    Attributes
    ----------
    chain_start, chain : (e + 1,), (p,) runs of ``vertices_mm`` along each edge
    vertices_mm : (v, 3)
    faces : (e, 2) ids of the two faces; twice the same at the seam of a closed surface
    curve : (e,) `controller.cad.boundary.Curve`
    centre_mm, axis, radius_mm : (e, 3), (e, 3), (e,) of circles, NaN otherwise
    """

    chain_start: IntArray
    chain: IntArray
    vertices_mm: FloatArray
    faces: IntArray
    curve: IntArray
    centre_mm: FloatArray
    axis: FloatArray
    radius_mm: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class StepPart:
    """Contents of a STEP file.

    Attributes
    ----------
    solid : solid with the file's faces
    step_face : (f,) place of each face in the file's own order, from 0; of its first piece where
        the file has it in several
    edges : edges with their exact curves
    area_mm2 : area of the whole surface
    inertia_mm5 : (3, 3) about the centroid, of density 1
    tolerances : dimensions, geometric tolerances and datums; empty where the file has none
    warnings : sentences on what could not be read
    """

    solid: Solid
    step_face: IntArray
    edges: StepEdges
    area_mm2: float
    inertia_mm5: FloatArray
    tolerances: tuple[Tolerance, ...]
    warnings: tuple[str, ...]


def read_step(path: Path, body: str | None = None) -> Solid:
    """Return the solid of a STEP file, proven to be one closed solid.

    Parameters
    ----------
    path : path of the file
    body : name of one of its bodies, None for a file of one

    Raises
    ------
    UnreadableCadError : missing, damaged, no STEP kernel installed, or one that crashed or hung;
        no such body; files that it names are missing
    EmptyCadError, OpenCadError, ManySolidsCadError : not exactly one solid body
    """
    return read_step_part(path, body=body).solid


def list_bodies(path: Path) -> Bodies:
    """Return the bodies of a STEP file; raises UnreadableCadError or EmptyCadError."""
    data = _read_text(path)
    check_installed(str(path))
    return open_bodies(path, collect(path, data))


def read_step_part(
    path: Path, limits: KernelLimits | None = None, body: str | None = None
) -> StepPart:
    """Return all a STEP file says of a part.

    Parameters
    ----------
    path : path of the file
    limits : on memory and time of the kernel; None for the usual ones
    body : name of one of its bodies, in the coordinates of its own product; None for a file of one
        body, as placed in the file

    Raises
    ------
    ManySolidsCadError : it has several bodies, and none is named
    CadError : as in `read_step`
    """
    data = _read_text(path)
    check_installed(str(path))
    files = collect(path, data)
    if body == EVERY:
        united = unite(path, files, limits)
        chosen = BodyOfFile(require_whole(path, united), united.unit, files, united.caution)
        return _read_part(path, data, limits, chosen)
    if body is None and files.missing == () and len(files.found) == 1:
        try:
            return _read_part(path, data, limits, None)
        except ManySolidsCadError as error:
            try:
                bodies = open_bodies(path, files, limits)
            except UnreadableCadError:
                raise error from None  # that there are several is known all the same
            raise ManySolidsCadError(_many(path, files, bodies)) from error
    bodies = open_bodies(path, files, limits)
    if body is not None:
        chosen_body = choose(path, bodies, body)
    else:
        try:
            chosen_body = require_one(path, bodies)
        except ManySolidsCadError as error:
            raise ManySolidsCadError(_many(path, files, bodies)) from error
    caution = CODE_PAGE_TEXT if bodies.is_in_code_page else ""
    return _read_part(path, data, limits, BodyOfFile(chosen_body, bodies.unit, files, caution))


def _many(path: Path, files: References, bodies: Bodies) -> str:
    """Return a sentence that refuses a file of several bodies, and reports if they touch."""
    touching = touching_text(path, files, bodies)
    return "\n".join(filter(None, (many(path, bodies), touching)))


@dataclass(frozen=True, eq=False, slots=True)
class BodyOfFile:
    """One body, with the data of its file.

    Attributes
    ----------
    body : without a name where it is all bodies of the file in one
    unit : unit of length, in the kernel's spelling
    files : the file, and those it names
    caution : a caution about the result, in a sentence
    """

    body: StepBody
    unit: str
    files: References
    caution: str = ""

    @property
    def is_whole_file(self) -> bool:
        """True if it is all bodies of the file in one."""
        return not self.body.name

    @property
    def content_hash(self) -> str:
        """SHA-256 of the body's name, the file, and the files it names, with their names."""
        digests = [hashlib.sha256(data).hexdigest() for data in self.files.found.values()]
        _, *others = self.files.found
        said = (self.body.name or EVERY, *digests, *others)
        return hashlib.sha256("\n".join(said).encode()).hexdigest()


def _read_part(
    path: Path, data: bytes, limits: KernelLimits | None, chosen: BodyOfFile | None
) -> StepPart:
    """Return a file's only body as placed in it, or the chosen one in its own coordinates."""
    named = "" if chosen is None else chosen.body.name or EVERY
    where = str(body_path(path, named)) if named else str(path)
    name = CadSource(path).part_name if named in ("", EVERY) else named
    content_hash = hashlib.sha256(data).hexdigest() if chosen is None else chosen.content_hash
    with ExitStack() as stack:
        # the kernel reads a copy, so that it sees what was hashed, whatever the name
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="cellctl-step-")))
        source = text = folder / "part.step"
        text.write_bytes(for_kernel(data))
        if chosen is not None:
            source = folder / "body.bin"
            source.write_bytes(chosen.body.shape)
        pmi_run = None
        # tolerances of a body in another file stay there
        has_own = chosen is None or not (chosen.is_whole_file or len(chosen.files.found) > 1)
        if has_own and SEMANTIC.search(data):
            product = ("", "0") if chosen is None else (chosen.body.product, chosen.body.number)
            pmi_run = stack.enter_context(
                KernelRun("tolerances", text, folder / "pmi.npz", [*map(str, product)], limits)
            )
        unit = None if chosen is None else chosen.unit
        written, found, into, solid = _tessellated(
            source, folder / "shape.npz", limits, (name, content_hash, where), unit
        )
        tolerances: tuple[Tolerance, ...] = ()
        warnings: tuple[str, ...] = (chosen.caution,) if chosen and chosen.caution else ()
        if chosen is not None and chosen.is_whole_file and SEMANTIC.search(data):
            warnings += ("Tolerances in the file, which are of single bodies, were not read.",)
        if str(written["how"]) in CHANGED:
            warnings += (CHANGED[str(written["how"])],)
        warnings += tuple(_left_out_text(written, face) for face in written["left_out"].tolist())
        if pmi_run is not None:
            try:
                pmi = pmi_run.result(where)
            except CadError as error:  # the geometry stands without them
                warnings += (f"its tolerances were not read: {error}",)
            else:
                ids = _ranks(found["area_mm2"])[into]
                tolerances, unread = tolerances_from(
                    pmi,
                    data,
                    written["area_mm2"],
                    written["mean_mm"],
                    ids,
                    is_whole_file=chosen is None,
                )
                warnings += unread
    return _part(found, into, solid, tolerances, warnings)


def _tessellated(
    source: Path,
    out: Path,
    limits: KernelLimits | None,
    named: tuple[str, str, str],
    unit: str | None,
) -> tuple[dict[str, Any], dict[str, Any], IntArray, Solid]:
    """Return the kernel's arrays, the same with merged faces, each face's new number, the solid.

    A result that is not closed is tried again: divided in another way, then repaired. For a file
    that stays unsound the reported reason refers to its surfaces as they are in the file.

    Raises
    ------
    CadError : as in `read_step`
    """
    name, content_hash, where = named
    refused: CadError | None = None
    for fineness in TESSELLATIONS:
        arguments = [str(number) for number in fineness]
        try:
            with KernelRun("solid", source, out, arguments, limits) as run:
                written: dict[str, Any] = dict(run.result(where))
        except UnreadableCadError as error:
            raise refused or error from None
        except CadError:
            if refused is None:
                raise
            continue
        if unit is not None:
            written["unit"] = np.array(unit)
        found, into = merge_faces(written)
        try:
            return written, found, into, _solid(found, name, content_hash, where)
        except (SelfIntersectingCadError, OpenCadError, InsideOutCadError) as error:
            refused = refused or error
    assert refused is not None
    raise refused


def _left_out_text(written: dict[str, Any], face: int) -> str:
    """Return the sentence on a surface that straight pieces replace."""
    x, y, z = written["mean_mm"][face]
    return (
        f"Surface {face + 1} of the file, about ({x:.1f}, {y:.1f}, {z:.1f}) mm, cannot be divided. "
        "It was left out, and the gap closed by straight pieces between its borders. Compare the "
        "part with its drawing there, or export it again."
    )


def _read_text(path: Path) -> bytes:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise UnreadableCadError(f"{path}: {error.strerror or error}; check the path") from error
    if not data.strip():
        raise EmptyCadError(f"{path}: the file is empty; export the part again")
    text = for_kernel(data)
    if BEGIN not in text[:1000]:
        raise UnreadableCadError(
            f"{path}: does not begin as STEP does (ISO-10303-21); is it the right file?"
        )
    if END not in text[-1000:]:  # the kernel would make something of half a file
        raise UnreadableCadError(f"{path}: the text breaks off; copy or export it again")
    check_numbers(path, text)
    return data


def _ranks(area_mm2: FloatArray) -> IntArray:
    """Return the id of each STEP face: its place by area, largest first."""
    rank = np.empty(len(area_mm2), dtype=np.int64)
    rank[np.argsort(-area_mm2, kind="stable")] = np.arange(len(area_mm2))
    return rank


def _solid(found: dict[str, Any], name: str, content_hash: str, where: str) -> Solid:
    for key in ("vertices_mm", "area_mm2", "volume_mm3", "centroid_mm"):
        if not np.isfinite(found[key]).all():
            raise UnreadableCadError(
                f"{where}: its numbers lead to nothing finite; export it again"
            )
    rank = _ranks(found["area_mm2"])
    mesh = trimesh.Trimesh(found["vertices_mm"], found["triangles"], process=False)
    volume_mm3 = float(found["volume_mm3"])
    solid = make_solid(
        mesh,
        name,
        content_hash,
        where,
        faces=_faces(found, mesh, rank),
        face_of_triangle=rank[found["face_of_triangle"]].astype(np.int32),
        unit=UNITS.get(str(found["unit"]).lower(), "mm"),
        unit_is_declared=True,
    )
    if abs(solid.mesh.volume - volume_mm3) > MESH_SHARE * abs(volume_mm3):
        raise OpenCadError(
            f"{where}: its surfaces hold {volume_mm3:.1f} mm3, between its edges are "
            f"{solid.mesh.volume:.1f} mm3; surfaces and edges do not fit, export it again"
        )
    return replace(solid, volume_mm3=volume_mm3, centroid_mm=found["centroid_mm"])


def _part(
    found: dict[str, Any],
    into: IntArray,
    solid: Solid,
    tolerances: tuple[Tolerance, ...],
    warnings: tuple[str, ...],
) -> StepPart:
    rank = _ranks(found["area_mm2"])
    edges = StepEdges(
        found["chain_start"],
        found["chain"],
        found["vertices_mm"],
        np.where(found["edge_faces"] < 0, -1, rank[found["edge_faces"]]),
        found["curve"],
        found["curve_centre_mm"],
        found["curve_axis"],
        found["curve_radius_mm"],
    )
    return StepPart(
        solid=solid,
        step_face=np.unique(into, return_index=True)[1][np.argsort(rank)],
        edges=edges,
        area_mm2=float(found["surface_mm2"]),
        inertia_mm5=found["inertia_mm5"],
        tolerances=tolerances,
        warnings=warnings,
    )


def _faces(found: dict[str, Any], mesh: trimesh.Trimesh, rank: IntArray) -> tuple[Face, ...]:
    count = len(rank)
    of = found["face_of_triangle"]
    corners = np.asarray(mesh.vertices)[np.asarray(mesh.faces)]
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    middle = corners.mean(axis=1)
    total = np.zeros((count, 3))
    np.add.at(total, of, doubled / 2)
    inward = np.zeros(count)  # of a curved surface: where its normals point to its own axis
    np.add.at(inward, of, -(doubled * _outward(found, of, middle)).sum(axis=1))
    faces: list[Face] = []
    for step_face in np.argsort(rank):
        kind = KINDS[int(found["kind"][step_face])]
        area = float(found["area_mm2"][step_face])
        place, axis = found["place_mm"][step_face], found["axis"][step_face]
        centre = found["mean_mm"][step_face]
        radius, minor, half_angle = (float(r) for r in found["radii"][step_face])
        if kind in {"cylinder", "cone"}:
            along = float((centre - place) @ axis)
            centre = place + along * axis
            radius += along * np.tan(half_angle)
            if half_angle < 0:
                half_angle, axis = -half_angle, -axis
        elif kind in {"sphere", "torus"}:
            centre = place
        length = float(np.linalg.norm(total[step_face]))
        faces.append(
            Face(
                id=int(rank[step_face]),
                kind=kind,
                area_mm2=area,
                normal=total[step_face] / length if length > 1e-6 * area else np.zeros(3),
                axis=axis if kind in {"cylinder", "cone", "torus"} else np.zeros(3),
                centre_mm=centre,
                radius_mm=abs(radius),
                minor_radius_mm=minor,
                half_angle_rad=half_angle,
                concave=bool(inward[step_face] > 0),
                turn_rad=turn_of(length / area) if kind == "cylinder" else 0.0,
            )
        )
    return tuple(faces)


def _outward(found: dict[str, Any], of: IntArray, points: FloatArray) -> FloatArray:
    """Return vectors (n, 3) from the axis, centre or ring of each point's surface to the point."""
    kind = np.array(KINDS)[found["kind"]][of]
    arm = points - found["place_mm"][of]
    axis = found["axis"][of]
    radial = arm - (arm * axis).sum(axis=1)[:, None] * axis
    length = np.maximum(np.linalg.norm(radial, axis=1), 1e-12)[:, None]
    ring = arm - radial / length * found["radii"][of, :1]
    out = np.zeros_like(points)
    for kinds, way in ((("cylinder", "cone"), radial), (("sphere",), arm), (("torus",), ring)):
        chosen = np.isin(kind, kinds)
        out[chosen] = way[chosen]
    return out
