"""Puts the page of compiled parts together: stable poses, features, tolerances."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from controller.cad import StablePose
from controller.cad.boundary import Crease, Curve
from controller.cad.compiled import CompiledPart
from controller.cad.views import LineView
from controller.imaging import RayCaster

from ..line_drawing import Drawing, DrawingFrame, draw, frame_of
from ..pages import make_environment, write_page
from ..ray_drawing import png_bytes
from ._words_of import vector
from .picture import rest_picture, shade
from .tables import Row, feature_rows, tolerance_rows

TEMPLATES = ("sheet.html.j2", "sheet.css")
SCALE_WORDS = {Curve.LINE: "straight", Curve.CIRCLE: "circular", Curve.OTHER: "other"}
CREASE_WORDS = {Crease.CONVEX: "convex", Crease.CONCAVE: "concave", Crease.SMOOTH: "smooth"}


@dataclass(frozen=True, slots=True)
class PoseSheet:
    """A stable pose on the page.

    Attributes
    ----------
    pose, view : as compiled
    up : direction it is seen from in the CAD frame, as in Table 1 of the paper
    picture : data URI
    drawing : its view from above
    remarks : further remarks, in words
    """

    pose: StablePose
    view: LineView
    up: str
    picture: str
    drawing: Drawing
    remarks: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class PartSheet:
    """A part on the page.

    Attributes
    ----------
    part : as compiled
    mass_g, density_g_cm3 : its mass, and the density assumed
    frame : frame of all its drawings
    poses : one sheet each
    edges_in_words : number of edges of each kind
    features, tolerances : rows of their tables
    """

    part: CompiledPart
    mass_g: float
    density_g_cm3: float
    frame: DrawingFrame
    poses: tuple[PoseSheet, ...]
    edges_in_words: str
    features: tuple[Row, ...]
    tolerances: tuple[Row, ...]


def write_sheet(parts: Sequence[CompiledPart], density_g_cm3: float | None, path: Path) -> Path:
    """Write the page of parts and return its path; the file is whole or not there.

    Parameters
    ----------
    parts : the parts, in the order of the page
    density_g_cm3 : density of all parts; None for the one in each file, or else of aluminium
    path : HTML file to write

    Raises
    ------
    OSError : the file cannot be written
    """
    return write_page(render_sheet(parts, density_g_cm3), path)


def write_part_drawings(part: CompiledPart, folder: Path) -> tuple[str, ...]:
    """Write what another program draws a part with; return the name of each pose's picture.

    ``mesh.json`` has ``vertices`` [mm, CAD frame] and ``triangles``, three numbers after another,
    and ``face_of_triangle``.

    Parameters
    ----------
    part : compiled
    folder : is there

    Raises
    ------
    OSError : a file cannot be written
    """
    solid = part.solid
    mesh = {
        "vertices": np.round(np.asarray(solid.mesh.vertices), 3).ravel().tolist(),
        "triangles": np.asarray(solid.mesh.faces).ravel().tolist(),
        "face_of_triangle": np.asarray(solid.face_of_triangle).tolist(),
    }
    (folder / "mesh.json").write_text(json.dumps(mesh, separators=(",", ":")), encoding="utf-8")
    caster, names = RayCaster(solid.mesh), []
    for pose in part.poses:
        name = f"pose-{pose.index}.png"
        (folder / name).write_bytes(png_bytes(shade(solid, caster, pose.R), compression=6))
        names.append(name)
    return tuple(names)


def render_sheet(parts: Sequence[CompiledPart], density_g_cm3: float | None) -> str:
    """Return the page."""
    environment = make_environment(__package__, TEMPLATES)
    environment.filters["vector"] = vector
    return environment.get_template("sheet.html.j2").render(
        sheets=[_part_sheet(part, density_g_cm3) for part in parts]
    )


def _part_sheet(part: CompiledPart, density_g_cm3: float | None) -> PartSheet:
    density = part.density_g_cm3(density_g_cm3)
    frame = frame_of(part.views)
    caster = RayCaster(part.solid.mesh)
    poses = [
        PoseSheet(
            pose=pose,
            view=view,
            up=vector(pose.R[2]),
            picture=rest_picture(part.solid, caster, pose.R),
            drawing=draw(view, frame.unit),
            remarks=part.remarks(pose),
        )
        for pose, view in zip(part.poses, part.views, strict=True)
    ]
    return PartSheet(
        part=part,
        mass_g=part.solid.volume_mm3 / 1000 * density,
        density_g_cm3=density,
        frame=frame,
        poses=tuple(poses),
        edges_in_words=_edges_in_words(part),
        features=feature_rows(part),
        tolerances=tolerance_rows(part),
    )


def _edges_in_words(part: CompiledPart) -> str:
    boundary = part.solid.boundary
    by_curve = [
        f"{count} {SCALE_WORDS[kind]}"
        for kind in Curve
        if (count := int((boundary.curve == kind).sum()))
    ]
    by_crease = [
        f"{count} {CREASE_WORDS[kind]}"
        for kind in Crease
        if (count := int((boundary.crease == kind).sum()))
    ]
    if not by_curve:
        return "none"
    return f"{boundary.edge_count}: {', '.join(by_curve)}; {', '.join(by_crease)}"
