"""Findings from marks: extent in the full picture, kind, and place.

A speck of dust is as small as the blur allows and is no defect. The size of a mark is measured in
the picture itself, at half of its contrast.
"""

from typing import Final

import cv2
import numpy as np

from controller.arrays import BoolArray, Grey

from .._connected import border_of, nearest_on_part
from .._pose import PosedPart, PoseFit
from .._types import Finding, FindingKind, ViewTask
from .marks import MIN_CONTRAST, MIN_GAIN, SPOT_NODES, Answers
from .surface import Surface
from .texture import Texture

BLUR_PX: Final = 1.65  # full width at half maximum of a point through a good lens
SOFT_PX: Final = 0.7  # smoothing that removes the noise of single pixels from a speck
BORDER_PX: Final = 3  # width along a face's border in which blur mixes in its neighbours
WIDTH: Final = 2.355  # full width at half maximum of a Gaussian, in standard deviations
LONG: Final = 3.0  # ratio of length to width from which a mark is a line
MAX_MARKS: Final = 40  # largest number of marks in a picture; more come from a coarse finish
BOTH_SIDES: Final = 0.4  # least strength of a dent's darker side, as a share of its brighter side
STAIN_MM: Final = 3.0  # width from which a mark of one sign is a stain


def local_findings(
    answer: Answers,
    texture: Texture,
    picture: Grey,
    surface: Surface,
    part: PosedPart,
    fit: PoseFit,
    task: ViewTask,
    lamp_name: str,
    step_px: int,
) -> list[Finding]:
    """Return the marks of a picture beyond its texture, strongest first.

    Parameters
    ----------
    answer : responses of the filters to the texture
    texture : texture of the picture's faces
    picture : (height, width) grey, for details smaller than a node
    surface : surface seen by the nodes
    part, fit, task : the part, its pose, the view
    lamp_name : lamp of the picture
    step_px : distance between the nodes
    """
    height = np.abs(answer.excess)
    strength = height / answer.limit
    marked = np.asarray((height >= answer.weak).any(axis=0))
    count, label, stats, _ = cv2.connectedComponentsWithStats(
        cv2.dilate(marked.astype(np.uint8), np.ones((3, 3), np.uint8)), connectivity=8
    )
    found: list[tuple[float, Finding]] = []
    for i in range(1, count):
        x, y, w, h = (int(v) for v in stats[i, :4])
        window = (slice(y, y + h), slice(x, x + w))
        here = label[window] == i
        local = np.where(here, strength[:, window[0], window[1]], 0.0)
        which, row, column = np.unravel_index(int(local.argmax()), local.shape)
        peak = (y + int(row), x + int(column))
        mark = _measure(answer, texture, surface, int(which), peak, here, window)
        if mark is None:
            continue
        extent, length_mm, kind, contrast, dipole = mark
        if abs(contrast) < MIN_GAIN * MIN_CONTRAST:
            continue  # it answers to a light or a dark beside it, and is neither
        corner, dust_mm = fit.maps.roi[:2], task.limits.dust_mm
        if is_dust(picture, corner, peak, step_px, dust_mm, surface, length_mm):
            continue
        found.append(
            (
                float(local.max()),
                _finding(
                    extent,
                    kind,
                    lamp_name,
                    part,
                    fit,
                    task,
                    surface,
                    step_px,
                    length_mm,
                    float(local.max()),
                    contrast,
                    dipole,
                ),
            )
        )
    found.sort(key=lambda item: -item[0])
    return [f for _, f in found[:MAX_MARKS]]


def _measure(
    answer: Answers,
    texture: Texture,
    surface: Surface,
    which: int,
    peak: tuple[int, int],
    here: BoolArray,
    window: tuple[slice, slice],
) -> tuple[BoolArray, float, FindingKind, float, tuple[float, float]] | None:
    """Return a mark's nodes (h, w), its length [mm], kind, contrast and dipole."""
    soft = cv2.GaussianBlur(texture.contrast, (0, 0), 0.7 if which >= len(SPOT_NODES) else
                            max(0.7, 0.5 * SPOT_NODES[which]))  # fmt: skip
    reach = 6 if which >= len(SPOT_NODES) else int(3 * SPOT_NODES[which]) + 3
    y0, y1 = max(window[0].start - reach, 0), window[0].stop + reach
    x0, x1 = max(window[1].start - reach, 0), window[1].stop + reach
    patch = soft[y0:y1, x0:x1]
    near = np.zeros(patch.shape, dtype=np.uint8)
    near[window[0].start - y0 :, window[1].start - x0 :][: here.shape[0], : here.shape[1]] = here
    wide = cv2.dilate(near, np.ones((5, 5), np.uint8))
    inside = (wide > 0) & (texture.region[y0:y1, x0:x1] > 0)
    if not inside.any():
        return None
    most, least = float(patch[inside].max()), float(patch[inside].min())
    contrast = most if most > -least else least
    body = inside & (patch * np.sign(contrast) >= 0.5 * abs(contrast))
    both = inside & (np.abs(patch) >= 0.5 * min(most, -least)) if min(most, -least) > 0 else body
    is_dipole = min(most, -least) >= BOTH_SIDES * max(most, -least)
    extent_small = both if is_dipole else body
    rows, columns = np.nonzero(extent_small)
    node = float(surface.node_mm[peak])
    slant = 1.0 / max(float(surface.cosine[peak]), 0.2)
    points = np.column_stack([columns, rows]).astype(np.float64)
    centred = points - points.mean(axis=0)
    spread = np.linalg.eigvalsh(centred.T @ centred / max(len(points), 1) + np.eye(2) / 12.0)
    length, width = (float(np.sqrt(12 * s)) for s in (spread[1], spread[0]))
    is_line = which >= len(SPOT_NODES) and length > LONG * width
    is_line |= length > 2 * LONG * width
    length_mm = float(length * node * np.sqrt(slant))
    dipole = (0.0, 0.0)
    if is_dipole:
        weight = np.where(inside, patch, 0.0)
        bright = np.argwhere(weight >= 0.5 * most).mean(axis=0)
        dark = np.argwhere(weight <= 0.5 * least).mean(axis=0)
        dipole = (float(bright[1] - dark[1]), float(bright[0] - dark[0]))
    if is_line:
        kind = FindingKind.SCRATCH
    elif is_dipole:
        kind = FindingKind.DENT
    elif length_mm >= STAIN_MM:
        kind = FindingKind.STAIN
    else:
        kind = FindingKind.PIT
    extent = np.zeros(texture.region.shape, dtype=bool)
    extent[y0:y1, x0:x1] = extent_small
    return extent, length_mm, kind, contrast, dipole


def is_dust(
    picture: Grey,
    corner_px: tuple[int, int],
    peak: tuple[int, int],
    step_px: int,
    dust_mm: float,
    surface: Surface,
    length_mm: float,
) -> bool:
    """Return True if a mark is no larger than a speck of dust, less the lens's blur.

    Parameters
    ----------
    picture : (height, width) grey
    corner_px : x, y of the first node
    peak : row and column of the node with the largest response
    step_px : distance between the nodes
    dust_mm : size of the largest speck
    surface : surface seen by the nodes
    length_mm : length of the mark, measured on the nodes
    """
    node_mm = float(surface.node_mm[peak])
    px_mm = node_mm / step_px
    if length_mm > 4 * dust_mm + 3 * node_mm:
        return False
    reach = int(np.ceil(2 * dust_mm / px_mm)) + 6
    x0, y0 = corner_px
    x, y = peak[1] * step_px, peak[0] * step_px
    rows = np.arange(max(y - reach, 0), min(y + reach + 1, step_px * surface.face.shape[0]))
    columns = np.arange(max(x - reach, 0), min(x + reach + 1, step_px * surface.face.shape[1]))
    rows, columns = rows[y0 + rows < picture.shape[0]], columns[x0 + columns < picture.shape[1]]
    own = surface.face[rows[:, None] // step_px, columns // step_px] == surface.face[peak]
    values = picture[y0 + rows[:, None], x0 + columns].astype(np.float32)
    soft = np.asarray(cv2.GaussianBlur(values, (0, 0), SOFT_PX))
    # Use its own face alone: beside a narrow face, others are brighter or darker.
    level = np.full(soft.shape, float(np.median(soft[own])))
    # and blur brings them into it: what all along the border has is no mark
    inwards = cv2.distanceTransform(own.astype(np.uint8), cv2.DIST_C, 3)
    for ring in range(1, BORDER_PX + 1):
        along = own & (inwards == ring)
        if along.any():
            level[along] = np.median(soft[along])
    off = np.where(own, np.abs(soft - level), 0.0)
    near = (np.abs(rows[:, None] - y) <= 4) & (np.abs(columns - x) <= 4)
    middle = np.where(near, off, 0.0)
    half = off >= 0.5 * float(middle.max())
    _, labels = cv2.connectedComponents(half.astype(np.uint8), connectivity=8)
    row, column = np.unravel_index(int(middle.argmax()), middle.shape)
    body = labels == labels[row, column]
    width_px = 2.0 * np.sqrt(float(body.sum()) / np.pi)
    true_px = np.sqrt(max(width_px**2 - BLUR_PX**2 - (WIDTH * SOFT_PX) ** 2, 0.0))
    return bool(true_px * px_mm <= dust_mm)


def _finding(
    extent: BoolArray,
    kind: FindingKind,
    lamp_name: str,
    part: PosedPart,
    fit: PoseFit,
    task: ViewTask,
    surface: Surface,
    step_px: int,
    length_mm: float,
    evidence: float,
    contrast: float,
    dipole: tuple[float, float],
) -> Finding:
    rows, columns = np.nonzero(extent)
    x0, y0, _, _ = fit.maps.roi
    xs, ys = x0 + columns * step_px, y0 + rows * step_px
    point, faces = nearest_on_part(part, fit.maps, task.camera, fit.T_world_part, xs, ys)
    area = float(surface.area_mm2[extent].sum()) * step_px**2
    return Finding(
        kind=kind,
        lamp=lamp_name,
        area_mm2=area,
        size_mm=length_mm,
        at_px=(float(xs.mean()), float(ys.mean())),
        box_px=(int(xs.min()), int(ys.min()), int(xs.max()) + step_px, int(ys.max()) + step_px),
        p_part_mm=point,
        face_ids=faces,
        evidence=evidence,
        contrast=contrast,
        dipole_px=dipole,
        outline_px=border_of(extent, (x0, y0), step_px),
    )
