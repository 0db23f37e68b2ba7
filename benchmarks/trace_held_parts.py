"""Parts that are held: drawn by a seed, with every hole, boss and rib known, or read from files.

A part is a list of bodies added and cut, then its holes. Each can be left out, moved or made
another size, and the solid is built again: so what is true of a specimen is known from how it
was made, not measured. Millimetres, CAD frame.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from manifold3d import CrossSection, Manifold, Mesh
from numpy.typing import NDArray

from controller.cad import find_features, load_solid

Array = NDArray[np.float64]
Body = Any  # manifold3d's solid

SAG_MM = 0.001  # of a round wall's facets, in what is traced
NOMINAL_SAG_MM = 0.004  # in the CAD file that the judge gets
REACH_MM = 0.5  # a hole is cut this far beyond its open ends
PLUG_MM = 0.05  # a plug is this much larger than the hole it fills, in radius


@dataclass(frozen=True, eq=False)
class Hole:
    """A plain round hole.

    Attributes
    ----------
    id : in truth.json
    mouth_mm, bottom_mm : (3,) ends of its wall, on the axis
    diameter_mm : of its wall
    is_through : open at the bottom as well
    """

    id: str
    mouth_mm: Array
    bottom_mm: Array
    diameter_mm: float
    is_through: bool

    @property
    def axis(self) -> Array:
        """Unit vector out of the mouth, (3,)."""
        d = self.mouth_mm - self.bottom_mm
        return np.asarray(d / np.linalg.norm(d), np.float64)

    @property
    def depth_mm(self) -> float:
        return float(np.linalg.norm(self.mouth_mm - self.bottom_mm))

    def moved(self, shift_mm: Array) -> Hole:
        return replace(self, mouth_mm=self.mouth_mm + shift_mm, bottom_mm=self.bottom_mm + shift_mm)


@dataclass(frozen=True, eq=False)
class Step:
    """A body that is added or cut; a named one may be left out.

    Attributes
    ----------
    make : the body, by the sag of round walls [mm]
    adds : or cuts
    name : of a boss or a rib; else empty
    place_mm : (3,) its middle
    size_mm : its longest extent
    """

    make: Callable[[float], Body]
    adds: bool = True
    name: str = ""
    place_mm: Array = field(default_factory=lambda: np.zeros(3))
    size_mm: float = 0.0


@dataclass(frozen=True, eq=False)
class HeldPart:
    """A part that can be built again with changes.

    Attributes
    ----------
    name : of its CAD file, without the ending
    steps : in the order they are made
    holes : cut last
    is_cut : the steps have the holes already (read from a file)
    path : the CAD file it came from; None: it is drawn here
    """

    name: str
    steps: tuple[Step, ...]
    holes: tuple[Hole, ...]
    is_cut: bool = False
    path: Path | None = None

    def build(
        self,
        changed: Mapping[str, Hole | None] | None = None,
        without: Sequence[str] = (),
        sag_mm: float = SAG_MM,
    ) -> Body:
        """Return the solid.

        Parameters
        ----------
        changed : holes by id, as they are instead; None: left out
        without : names of steps left out
        sag_mm : of round walls
        """
        changed = changed or {}
        out = Manifold()
        for step in self.steps:
            if not step.name or step.name not in without:
                body = step.make(sag_mm)
                out = out + body if step.adds else out - body
        for hole in self.holes:
            if self.is_cut and hole.id not in changed:
                continue
            if self.is_cut:
                out = out + rod(
                    hole.bottom_mm, hole.mouth_mm, hole.diameter_mm + 2 * PLUG_MM, sag_mm
                )
            now = changed.get(hole.id, hole)
            if now is not None:
                out = out - bore(now, sag_mm)
        return out


def round_parts(radius_mm: float, sag_mm: float) -> int:
    """Return into how many facets a circle is parted."""
    return int(4 * np.ceil(np.pi / np.arccos(1 - sag_mm / max(radius_mm, 2 * sag_mm)) / 4))


def rod(
    low_mm: Array, high_mm: Array, diameter_mm: float, sag_mm: float, high_diameter_mm: float = 0.0
) -> Body:
    """Return a cylinder, or a cone, between two points; its facets have the circle's area.

    Parameters
    ----------
    low_mm, high_mm : ends of its axis
    diameter_mm : at the low end, and at the high one where none is given
    sag_mm : of its facets
    high_diameter_mm : of a cone
    """
    axis = np.asarray(high_mm, float) - low_mm
    length = float(np.linalg.norm(axis))
    radius = diameter_mm / 2
    n = round_parts(max(radius, high_diameter_mm / 2), sag_mm)
    # a CAD file has its facets' corners on the circle; what is traced has the circle's area
    is_traced = sag_mm < NOMINAL_SAG_MM
    wider = 1.0 / np.sqrt(np.sin(2 * np.pi / n) / (2 * np.pi / n)) if is_traced else 1.0
    high = high_diameter_mm / 2 if high_diameter_mm else radius
    body = Manifold.cylinder(length, radius * wider, high * wider, n)
    return placed(body, frame(axis / length, np.asarray(low_mm, float)))


def bore(hole: Hole, sag_mm: float) -> Body:
    """Return what is cut away for a hole."""
    low = hole.bottom_mm - (REACH_MM if hole.is_through else 0.0) * hole.axis
    return rod(low, hole.mouth_mm + REACH_MM * hole.axis, hole.diameter_mm, sag_mm)


def frame(z: Array, origin: Array) -> Array:
    """Return a pose (4, 4) whose z axis is given."""
    x = np.eye(3)[np.abs(z).argmin()]
    x = x - (x @ z) * z
    x /= np.linalg.norm(x)
    T = np.eye(4)
    T[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    T[:3, 3] = origin
    return T


def placed(body: Body, T: Array) -> Body:
    return body.transform(np.ascontiguousarray(T[:3, :4]))


def prism(outline_mm: Sequence[Sequence[float]], height_mm: float, T: Array | None = None) -> Body:
    """Return an extruded outline from z = 0 on, then placed."""
    points = np.asarray(outline_mm, float)
    x, y = points.T
    if x @ np.roll(y, -1) - y @ np.roll(x, -1) < 0:
        points = points[::-1]
    body = CrossSection([points]).extrude(height_mm)
    return body if T is None else placed(body, T)


def block(low_mm: Sequence[float], high_mm: Sequence[float]) -> Body:
    low, high = np.asarray(low_mm, float), np.asarray(high_mm, float)
    return Manifold.cube(high - low).translate(low)


def triangles_of(body: Body) -> Array:
    """Return triangles (n, 3, 3) of a solid."""
    mesh = body.to_mesh64()
    out: Array = np.asarray(mesh.vert_properties)[:, :3][np.asarray(mesh.tri_verts)]
    return out


def body_of(mesh: trimesh.Trimesh) -> Body:
    """Return the solid that a closed mesh bounds."""
    merged = trimesh.Trimesh(mesh.vertices, mesh.faces, process=True)
    return Manifold(
        Mesh(
            np.ascontiguousarray(merged.vertices, np.float32),
            np.ascontiguousarray(merged.faces, np.uint32),
        )
    )


def write_stl(body: Body, path: Path) -> None:
    triangles = triangles_of(body)
    trimesh.Trimesh(
        triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3), process=False
    ).export(path)


def _through(name: str, at: Sequence[float], to: Sequence[float], d: float) -> Hole:
    return Hole(name, np.asarray(at, float), np.asarray(to, float), round(d, 3), is_through=True)


def _blind(name: str, at: Sequence[float], to: Sequence[float], d: float) -> Hole:
    return Hole(name, np.asarray(at, float), np.asarray(to, float), round(d, 3), is_through=False)


def _fixed(body: Body, *, adds: bool = True) -> Step:
    return Step(lambda _sag: body, adds)


def _rod_step(
    low: Sequence[float], high: Sequence[float], d: float, *, adds: bool = True, name: str = ""
) -> Step:
    a, b = np.asarray(low, float), np.asarray(high, float)
    size = max(d, float(np.linalg.norm(b - a)))
    return Step(lambda sag: rod(a, b, d, sag), adds, name, (a + b) / 2, size)


def _obround(x: float, y: float, length: float, width: float, low: float, high: float) -> Step:
    """Return a slot along x to be cut."""

    def make(sag: float) -> Body:
        half = (length - width) / 2
        ends = [rod(np.array([x + s, y, low]), np.array([x + s, y, high]), width, sag)
                for s in (-half, half)]  # fmt: skip
        middle = block((x - half, y - width / 2, low), (x + half, y + width / 2, high))
        return ends[0] + ends[1] + middle

    return Step(make, adds=False)


def _half(rng: np.random.Generator, low: float, high: float, step: float = 0.5) -> float:
    """Return a size as a drawing has it."""
    return float(np.round(rng.uniform(low, high) / step) * step)


def plate(rng: np.random.Generator) -> tuple[list[Step], list[Hole]]:
    """A plate with a boss, corner holes, a slot, a pocket and one corner off."""
    long, wide, t = _half(rng, 66, 92, 1), _half(rng, 46, 60, 1), _half(rng, 8, 13)
    cut = _half(rng, 8, 14, 1)
    d, h = _half(rng, 20, 28, 1), _half(rng, 4, 9)
    bx = -_half(rng, 4, 12, 1)
    x, y = long / 2, wide / 2
    outline = [[-x, -y], [x, -y], [x, y - cut], [x - cut, y], [-x, y]]
    slot_w = _half(rng, 6, 9)
    steps = [
        _fixed(prism(outline, t)),
        _rod_step((bx, 0, t - 1), (bx, 0, t + h), d, name="boss"),
        _obround(x - 14, -2, 7 + slot_w, slot_w, -1, t + 1),
        _fixed(block((-x + 5, y - 13, t - 2.5), (-x + 21, y - 7, t + 1)), adds=False),
    ]
    m, dh = _half(rng, 7, 9), _half(rng, 5, 8)
    holes = [
        _through("bore", (bx, 0, t + h), (bx, 0, 0), d - _half(rng, 7, 10, 1)),
        _through("hole_1", (-x + m, -y + m, t), (-x + m, -y + m, 0), dh),
        _through("hole_2", (x - m, -y + m, t), (x - m, -y + m, 0), dh),
        _through("hole_3", (x - m - cut, y - m - 1, t), (x - m - cut, y - m - 1, 0), dh),
        _blind("pin", (bx + 2, -y + m, t), (bx + 2, -y + m, t - 5), 4.0),
    ]
    return steps, holes


def bracket(rng: np.random.Generator) -> tuple[list[Step], list[Hole]]:
    """An angle with a rib, holes in both legs and a slope."""
    long, wide, high = _half(rng, 56, 80, 1), _half(rng, 40, 54, 1), _half(rng, 36, 50, 1)
    t = _half(rng, 7, 10)
    r = _half(rng, 5, 7)
    off = _half(rng, 2, 6, 1)
    slope = _half(rng, 8, 13, 1)
    y = wide / 2
    back = prism([[-y, 0], [y, 0], [y, high - slope], [y - slope, high], [-y, high]], t)
    # outline in y and z, extruded along x
    T = np.array([[0, 0, 1.0, 0], [1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, 0, 1]])
    T_rib = np.array([[1.0, 0, 0, 0], [0, 0, -1.0, off + r / 2], [0, 1.0, 0, 0], [0, 0, 0, 1]])
    low, far = t - 0.5, t + high * 0.55
    rib = prism([[low, low], [far, low], [low, far]], r, T_rib)
    middle = np.array([t + high * 0.18, off, t + high * 0.18])
    steps = [
        _fixed(block((0, -wide / 2, 0), (long, wide / 2, t))),
        _fixed(placed(back, T)),
        Step(lambda _sag: rib, name="rib", place_mm=middle, size_mm=high * 0.55),
    ]
    d = _half(rng, 6, 9)
    q = wide / 2 - _half(rng, 8, 10)
    beside = max(q - 4, off + r / 2 + d / 2 + 1)  # the rib
    holes = [
        _through("hole_1", (long - 10, -q, t), (long - 10, -q, 0), d),
        _through("hole_2", (long - 10, q, t), (long - 10, q, 0), d),
        _through("hole_3", (t + 14, -q, t), (t + 14, -q, 0), _half(rng, 4, 6)),
        _through("hole_4", (t, -q + 1, high - 12), (0, -q + 1, high - 12), _half(rng, 8, 12)),
        _through("hole_5", (t, beside, high * 0.48), (0, beside, high * 0.48), d),
    ]
    return steps, holes


def step_block(rng: np.random.Generator) -> tuple[list[Step], list[Hole]]:
    """A block with a shoulder, a groove, a broken edge, through and blind holes, a cross bore."""
    long, wide, high = _half(rng, 54, 76, 1), _half(rng, 36, 46, 1), _half(rng, 24, 32, 1)
    a, b = _half(rng, 18, 26, 1), _half(rng, 8, 12, 1)
    c = _half(rng, 3, 5)
    gx, gw, gd = _half(rng, 4, 8), _half(rng, 6, 9), _half(rng, 3, 5)
    y = wide / 2
    outline = [
        [0, 0],
        [long, 0],
        [long, high - b],
        [long - a, high - b],
        [long - a, high],
        [c, high],
        [0, high - c],
    ]
    T = np.array([[1.0, 0, 0, 0], [0, 0, -1.0, y], [0, 1.0, 0, 0], [0, 0, 0, 1]])
    steps = [
        _fixed(prism(outline, wide, T)),
        _fixed(block((gx + c, -y - 1, high - gd), (gx + c + gw, y + 1, high + 1)), adds=False),
    ]
    x1 = long - a / 2
    x2 = (gx + c + gw + long - a) / 2
    holes = [
        _through("hole_1", (x1, -y + 10, high - b), (x1, -y + 10, 0), _half(rng, 6, 9)),
        _through("hole_2", (x1, y - 10, high - b), (x1, y - 10, 0), _half(rng, 6, 9)),
        _through("hole_3", (x2, -y + 11, high), (x2, -y + 11, 0), _half(rng, 8, 11)),
        _blind("hole_4", (x2, y - 9, high), (x2, y - 9, high - 9), _half(rng, 5, 7)),
    ]
    return steps, holes


def hub(rng: np.random.Generator) -> tuple[list[Step], list[Hole]]:
    """A flange with a hub, a bolt circle, a flat and a keyway."""
    outer, t = _half(rng, 58, 78, 1), _half(rng, 8, 12)
    d, h = _half(rng, 28, 36, 1), _half(rng, 8, 15, 1)
    bore_d = d - _half(rng, 10, 14, 1)
    count = int(rng.integers(4, 7))
    flat = _half(rng, 3, 5)
    key = _half(rng, 4, 5)
    pitch = (outer + d) / 4
    rim = np.array([0.0, 0, 0]), np.array([0.0, 0, t])
    steps = [
        Step(lambda sag: rod(*rim, outer, sag)),
        _rod_step((0, 0, t - 1), (0, 0, t + h), d, name="boss"),
        _fixed(block((-outer, outer / 2 - flat, -1), (outer, outer, t + 0.01)), adds=False),
        _fixed(block((bore_d / 2 - 1, -key / 2, -1), (bore_d / 2 + 2.5, key / 2, t + h + 1)),
               adds=False),
    ]  # fmt: skip
    hole_d = _half(rng, 5, 8)
    holes = [_through("bore", (0, 0, t + h), (0, 0, 0), bore_d)]
    for i in range(count):
        angle = np.pi / 2 + np.pi / count + 2 * np.pi * i / count
        p = pitch * np.array([np.cos(angle), np.sin(angle)])
        holes.append(_through(f"hole_{i + 1}", (*p, t), (*p, 0), hole_d))
    holes.append(_blind("pin", (0, pitch - 2, t), (0, pitch - 2, t - 5), 4.0))
    return steps, holes


def fork(rng: np.random.Generator) -> tuple[list[Step], list[Hole]]:
    """A fork: a foot with holes and two cheeks with a bore across, one cheek lower."""
    long, wide, t = _half(rng, 54, 70, 1), _half(rng, 38, 46, 1), _half(rng, 8, 11)
    cheek, high = _half(rng, 7, 9), _half(rng, 26, 34, 1)
    width = _half(rng, 22, 28, 1)
    x0 = -_half(rng, 2, 6, 1)
    y = wide / 2
    steps = [_fixed(block((-long / 2, -y, 0), (long / 2, y, t)))]
    for sign, top in ((-1.0, high), (1.0, high - 5.0)):
        low, far = sorted((sign * (y - cheek), sign * y))
        body = block((x0 - width / 2, low, t - 1), (x0 + width / 2, far, t + top))
        place = np.array([x0, sign * (y - cheek / 2), t + top / 2])
        steps.append(
            Step(lambda _sag, body=body: body, name="" if sign < 0 else "cheek", place_mm=place,
                 size_mm=top)
        )  # fmt: skip
    z = t + high - 16
    d = _half(rng, 9, 13)
    small = _half(rng, 5.5, 7.5)
    left = min(-long / 2 + 8, x0 - width / 2 - small / 2 - 1)
    holes = [
        _through("cross_1", (x0, -y, z), (x0, -y + cheek, z), d),
        _through("cross_2", (x0, y, z), (x0, y - cheek, z), d),
        _through("hole_1", (left, -y + 9, t), (left, -y + 9, 0), small),
        _through("hole_2", (left, y - 9, t), (left, y - 9, 0), small),
        _through("hole_3", (long / 2 - 9, 3, t), (long / 2 - 9, 3, 0), small + 2),
    ]
    return steps, holes


def cover(rng: np.random.Generator) -> tuple[list[Step], list[Hole]]:
    """A shallow box open at the top with bosses and a rib inside."""
    long, wide, high = _half(rng, 60, 80, 1), _half(rng, 44, 56, 1), _half(rng, 16, 22, 1)
    wall, floor = _half(rng, 4, 6), _half(rng, 4, 6)
    x, y = long / 2, wide / 2
    rib_x = _half(rng, 2, 8, 1)
    inner = block((-x + wall, -y + wall, floor), (x - wall, y - wall, high + 1))
    rib = block((rib_x, -y + wall - 0.5, floor - 0.5), (rib_x + 4, y - wall + 0.5, high - 4))
    middle = np.array([rib_x + 2, 0, (floor + high - 4) / 2])
    bx, by = x - wall - 9, y - wall - 9
    d = _half(rng, 11, 14)
    top = high - 3
    steps = [
        _fixed(block((-x, -y, 0), (x, y, high))),
        Step(lambda _sag: inner, adds=False),
        Step(lambda _sag: rib, name="rib", place_mm=middle, size_mm=wide - 2 * wall),
        _rod_step((-bx, -by, floor - 1), (-bx, -by, top), d, name="boss"),
        _rod_step((bx, by, floor - 1), (bx, by, top), d, name="boss_2"),
        _fixed(block((x - wall - 1, -9, high - 6), (x + 1, 3, high + 1)), adds=False),
    ]  # fmt: skip
    small = _half(rng, 5, 7)
    holes = [
        _through("hole_1", (-bx, -by, top), (-bx, -by, 0), small),
        _through("hole_2", (bx, by, top), (bx, by, 0), small),
        _through("hole_3", (-x / 2, by - 2, floor), (-x / 2, by - 2, 0), _half(rng, 7, 10)),
        _through("hole_4", (x / 2 + 4, -by + 2, floor), (x / 2 + 4, -by + 2, 0), _half(rng, 7, 10)),
    ]
    return steps, holes


FAMILIES = {
    "plate": plate,
    "bracket": bracket,
    "step_block": step_block,
    "hub": hub,
    "fork": fork,
    "cover": cover,
}


def drawn(family: str, seed: int) -> HeldPart:
    """Return a part of a family with sizes drawn by a seed."""
    steps, holes = FAMILIES[family](np.random.default_rng([seed, len(family)]))
    return HeldPart(f"{family}_{seed}", tuple(steps), tuple(holes))


@lru_cache(maxsize=8)
def read_held_part(path: Path) -> HeldPart:
    """Return a part of a CAD file with its plain round holes."""
    if path.name.endswith(".csg.yaml"):
        with (
            tempfile.TemporaryDirectory() as folder
        ):  # what is traced is rounder than the file asks
            fine = Path(folder) / path.name
            text = re.sub(r"tolerance_mm:.*", f"tolerance_mm: {2 * SAG_MM}", path.read_text())
            fine.write_text(text)
            solid = load_solid(fine)
    else:
        solid = load_solid(path, unit="mm")
    body = body_of(solid.mesh)
    holes = []
    for feature in find_features(solid):
        if feature.kind != "hole" or len(feature.steps) != 1:
            continue
        if feature.steps[0].kind != "cylinder":
            continue
        mouth = np.asarray(feature.position_mm)
        hole = Hole(
            f"hole_{len(holes) + 1}",
            mouth,
            mouth + feature.depth_mm * np.asarray(feature.axis),
            feature.diameter_mm,
            feature.is_through,
        )
        if is_plain(body, hole):
            holes.append(hole)
    name = path.name.split(".")[0]
    return HeldPart(name, (_fixed(body),), tuple(holes), is_cut=True, path=path)


def is_plain(body: Body, hole: Hole) -> bool:
    """Whether a plug fills a hole flush, with nothing else filled and both ends plane."""
    plug = rod(hole.bottom_mm, hole.mouth_mm, hole.diameter_mm + 2 * PLUG_MM, SAG_MM)
    filled = (plug - body).volume()
    full = np.pi * (hole.diameter_mm / 2) ** 2 * hole.depth_mm
    if abs(filled / full - 1) > 0.01:
        return False
    # just beyond the wall there is metal all along, just beyond the ends there is none
    shell = rod(hole.bottom_mm, hole.mouth_mm, hole.diameter_mm + 0.6, SAG_MM) - plug
    lids = [(hole.mouth_mm + 0.01 * hole.axis, hole.mouth_mm + 0.3 * hole.axis)]
    if hole.is_through:
        lids.append((hole.bottom_mm - 0.3 * hole.axis, hole.bottom_mm - 0.01 * hole.axis))
    free = all((rod(*lid, hole.diameter_mm + 0.6, SAG_MM) ^ body).volume() < 0.02 for lid in lids)
    return bool(free and (shell ^ body).volume() > 0.97 * shell.volume())
