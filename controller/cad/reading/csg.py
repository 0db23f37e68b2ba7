"""CSG text, the modern BOXER (references.md P2.0): shapes joined, cut and placed; docs/csg.md.

Curves become polygons whose corners lie on the curve and whose sides stay within ``tolerance_mm``
of it; manifold3d does the set operations, exactly up to rounding.
"""

import difflib
import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import manifold3d
import numpy as np
import shapely
import trimesh

from controller.config.cad_files import CadSource
from controller.yaml_text import Location, YamlText

from ..errors import CsgCadError
from ..solid import Solid, make_solid
from ._ahead import check_ahead, size_of
from ._csg_models import CsgText, Shape
from .csg_text import MAX_BYTES, read_csg_text
from .units import read_unit

Body = Any  # a manifold3d.Manifold, which comes without types

MAX_SIDES: Final = 4096  # sides of a circle; a larger number means a wrong tolerance
MAX_TRIANGLES: Final = 200_000  # triangles of all shapes before they are joined
MAX_SHAPES: Final = 2_000
MIN_SIDES: Final = 12
GLOBE_SIDES: Final = 1.65  # a globe's widest triangles stay as close as a circle's chords
SET_OPERATIONS: Final = {
    "union": manifold3d.OpType.Add,
    "difference": manifold3d.OpType.Subtract,
    "intersection": manifold3d.OpType.Intersect,
}


def read_csg(path: Path) -> Solid:
    """Return the solid that a CSG text describes.

    Raises
    ------
    CsgCadError : unreadable or not what docs/csg.md says; names line and key, a problem a line
    CadError : as in `make_solid`, if what was built is no sound solid
    """
    check_ahead(path, path.suffix.lower(), size_of(path))
    with path.open("rb") as file:
        data = file.read(MAX_BYTES + 1)  # one more shows that it is too long
    model, yaml = read_csg_text(data, path)
    unit, mm_per_unit = read_unit(model.unit, path)
    body = _Builder(model, yaml, mm_per_unit).build()
    mesh = body.to_mesh64()
    return make_solid(
        trimesh.Trimesh(
            np.asarray(mesh.vert_properties, dtype=np.float64)[:, :3],
            np.asarray(mesh.tri_verts, dtype=np.int64),
            process=False,
        ),
        CadSource(path).part_name,
        hashlib.sha256(data).hexdigest(),
        where=str(path),
        unit=unit,
        density_g_cm3=model.density_g_cm3,
    )


class _Builder:
    """Builder of a text's part; named shapes are built once."""

    def __init__(self, model: CsgText, yaml: YamlText, mm_per_unit: float) -> None:
        self._model = model
        self._yaml = yaml
        self._mm_per_unit = mm_per_unit
        self._named: dict[str, Body] = {}
        self._costs: dict[str, tuple[int, int]] = {}

    def _problem(self, at: Location, reason: str) -> CsgCadError:
        return CsgCadError(self._yaml.sentence(at, reason))

    def build(self) -> Body:
        """Return the part [mm]; its cost is estimated first."""
        shapes, triangles = self._cost(self._model.part, ("part",), ())
        if shapes > MAX_SHAPES or triangles > MAX_TRIANGLES:
            raise self._problem(
                ("part",),
                f"is {shapes:,} shapes of {triangles:,} triangles, the most is {MAX_SHAPES:,} of "
                f"{MAX_TRIANGLES:,}; use fewer shapes or a coarser `tolerance_mm`",
            )
        return self._make(self._model.part, ("part",))

    def _cost(self, shape: Shape, at: Location, users: tuple[str, ...]) -> tuple[int, int]:
        """Return the number of shapes that a shape unfolds into, and of their triangles."""
        if shape.use is not None:
            return self._cost_of_named(shape.use, (*at, "use"), users)
        if shape.kind in SET_OPERATIONS:
            parts = [self._cost(inner, where, users) for inner, where in _inner(shape, at)]
            return sum(p[0] for p in parts), sum(p[1] for p in parts)
        return 1, self._triangles(shape, at)

    def _cost_of_named(self, name: str, at: Location, users: tuple[str, ...]) -> tuple[int, int]:
        if name not in self._model.shapes:
            near = difflib.get_close_matches(name, self._model.shapes, n=1, cutoff=0.5)
            known = ", ".join(list(self._model.shapes)[:20]) or "none"
            hint = f"did you mean `{near[0]}`?" if near else f"known: {known}"
            raise self._problem(at, f"no shape is named `{name:.40}`; {hint}")
        if name in users:
            round_trip = " -> ".join((*users[users.index(name) :], name))
            raise self._problem(at, f"a shape cannot use itself: {round_trip}; break the ring")
        if name not in self._costs:
            self._costs[name] = self._cost(
                self._model.shapes[name], ("shapes", name), (*users, name)
            )
        return self._costs[name]

    def _triangles(self, shape: Shape, at: Location) -> int:
        if shape.block is not None:
            return 12
        if shape.extrude is not None:
            return 4 * sum(len(o) for o in (shape.extrude.outline, *shape.extrude.holes))
        sides = self._sides(shape, at)
        if shape.sphere is not None:
            return sides**2 // 2
        return sides * (2 * len(shape.revolve.outline) if shape.revolve is not None else 4)

    def _sides(self, shape: Shape, at: Location) -> int:
        """Return the number of sides that keep a shape's widest circle within the tolerance."""
        if shape.cylinder is not None:
            radius = shape.cylinder.radius_units
        elif shape.cone is not None:
            radius = max(shape.cone.radii_units)
        elif shape.sphere is not None:
            radius = shape.sphere.radius_units
        elif shape.revolve is not None:
            radius = max(r for r, _ in shape.revolve.outline)
        else:
            raise ValueError(f"a {shape.kind} is not round")
        sagitta = min(self._model.tolerance_mm / max(radius * self._mm_per_unit, 1e-12), 1.0)
        sides = max(float(np.pi / np.arccos(1.0 - sagitta)), MIN_SIDES)
        if shape.sphere is not None:
            sides *= GLOBE_SIDES
        if sides > MAX_SIDES:
            raise self._problem(
                (*at, shape.kind),
                f"takes {sides:,.0f} sides at `tolerance_mm: {self._model.tolerance_mm:g}`, the "
                f"most is {MAX_SIDES:,}; choose a coarser tolerance",
            )
        return 4 * int(np.ceil(sides / 4))  # so that the points on the axes are corners

    def _make(self, shape: Shape, at: Location) -> Body:
        body = self._unplaced(shape, at)
        for turn in shape.turn:
            if isinstance(turn.about, str):
                # by the axis' name it is in degrees, so that a right angle is exactly right
                body = body.rotate(tuple(turn.deg * (turn.about == axis) for axis in "xyz"))
            else:
                T = trimesh.transformations.rotation_matrix(np.radians(turn.deg), turn.about)
                body = body.transform(T[:3, :4])
        if any(shape.move):
            body = body.translate(self._mm(shape.move))
        return body

    def _mm(self, lengths: Any) -> tuple[float, ...]:  # noqa: ANN401 - a tuple of two or three
        return tuple(float(length) * self._mm_per_unit for length in lengths)

    def _unplaced(self, shape: Shape, at: Location) -> Body:
        if shape.use is not None:
            if shape.use not in self._named:
                self._named[shape.use] = self._make(
                    self._model.shapes[shape.use], ("shapes", shape.use)
                )
            return self._named[shape.use]
        if shape.kind in SET_OPERATIONS:
            bodies = [self._make(inner, where) for inner, where in _inner(shape, at)]
            body = manifold3d.Manifold.batch_boolean(bodies, SET_OPERATIONS[shape.kind])
        else:
            body = self._primitive(shape, at)
        if body.status() != manifold3d.Error.NoError or body.is_empty():
            raise self._problem((*at, shape.kind), "nothing is left of it; check sizes and places")
        return body

    def _primitive(self, shape: Shape, at: Location) -> Body:
        manifold, mm = manifold3d.Manifold, self._mm_per_unit
        if shape.block is not None:
            if shape.block.size is not None:
                x, y, z = self._mm(shape.block.size)
                return manifold.cube((x, y, z)).translate((-x / 2, -y / 2, 0.0))
            low, high = self._mm(shape.block.from_), self._mm(shape.block.to)
            return manifold.cube(tuple(np.subtract(high, low))).translate(low)
        if shape.cylinder is not None:
            radius = shape.cylinder.radius_units * mm
            return manifold.cylinder(
                shape.cylinder.height * mm, radius, radius, self._sides(shape, at)
            )
        if shape.cone is not None:
            bottom, top = self._mm(shape.cone.radii_units)
            height, sides = shape.cone.height * mm, self._sides(shape, at)
            if bottom == 0.0:  # manifold3d wants the point on top
                return (
                    manifold.cylinder(height, top, 0.0, sides)
                    .mirror((0, 0, 1))
                    .translate((0, 0, height))
                )
            return manifold.cylinder(height, bottom, top, sides)
        if shape.sphere is not None:
            return manifold.sphere(shape.sphere.radius_units * mm, self._sides(shape, at))
        if shape.extrude is not None:
            outlines = [shape.extrude.outline, *shape.extrude.holes]
            section = self._section(outlines, (*at, "extrude"))
            return section.extrude(shape.extrude.height * mm)
        if shape.revolve is not None:
            section = self._section([shape.revolve.outline], (*at, "revolve"))
            return section.revolve(self._sides(shape, at))
        raise ValueError(f"{shape.kind} is no primitive")

    def _section(self, outlines: list[Any], at: Location) -> Any:  # noqa: ANN401 - CrossSection
        """Return an outline with holes, in either orientation."""
        polygons = [shapely.Polygon([self._mm(point) for point in o]) for o in outlines]
        places: list[Location] = [(*at, "outline")]
        places += [(*at, "holes", i) for i in range(len(outlines) - 1)]
        for polygon, place in zip(polygons, places, strict=True):
            if not polygon.is_valid or polygon.area <= 0:
                reason = shapely.is_valid_reason(polygon).replace("[", " at (").replace("]", ")")
                raise self._problem(place, f"crosses itself or is flat ({reason} mm); redraw it")
        outline = polygons[0]
        for hole, place in zip(polygons[1:], places[1:], strict=True):
            rest = outline.difference(hole)
            if not outline.contains(hole) or not isinstance(rest, shapely.Polygon):
                raise self._problem(place, "leaves the outline, or runs into another hole")
            outline = rest
        # anticlockwise outside, clockwise holes, as the section's fill rule wants them
        outline = shapely.geometry.polygon.orient(outline, 1.0)
        rings = [outline.exterior, *outline.interiors]
        return manifold3d.CrossSection([np.asarray(ring.coords)[:-1] for ring in rings])


def _inner(shape: Shape, at: Location) -> Iterator[tuple[Shape, Location]]:
    for i, inner in enumerate(getattr(shape, shape.kind)):
        yield inner, (*at, shape.kind, i)
