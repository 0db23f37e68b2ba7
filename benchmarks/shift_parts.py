"""The parts of a shift: good ones, defective ones and strangers, as CAD files and in random order.

What is wrong with a defective part is cut here, from the exact mesh, into a face that its recipe
inspects; nothing of the product has a hand in it.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from bench import ROOT
from bench_defects import as_body, as_mesh
from inspection_scenes import Held
from manifold3d import Manifold
from numpy.typing import NDArray

from controller.cad import find_features
from controller.config import load_recipe
from controller.setup.faces import faces_left_out

Array = NDArray[np.float64]

RECIPES = ("holder", "idler_riser", "featuretype", "flange_xy")
STRANGERS = ("tee_bracket", "v_block")
STRANGER_SHARE, DEFECT_SHARE = 0.03, 0.05
EDGE_MM = 8.0  # a defect keeps so far from the edges of its face, where that is large enough
GLOWING_MM = ((180.0, 540.0), (-225.0, 225.0))  # of the light table
# where a part is laid, wholly: there the camera above sees what is up to 70 mm high
SEEN_MM = ((192.0, 528.0), (-211.0, 211.0))
REACH_MM = ((250.0, 470.0), (-130.0, 130.0))  # where its centre may be
GAP_MM = 8.0  # between the circles about two parts
TRIES = 400


@dataclass(frozen=True, slots=True)
class ShiftPart:
    """One part that is laid on the table.

    Attributes
    ----------
    recipe : it is of; empty for a stranger
    file : CAD file of what really is there
    defect : what is wrong with it; empty for nothing
    radius_mm : of the circle about its centre of mass that holds it however it rests
    """

    recipe: str
    file: Path
    defect: str
    radius_mm: float

    @property
    def right_tray(self) -> str:
        """The tray it has to end in; empty where nobody may touch it."""
        if not self.recipe:
            return ""
        return "reject" if self.defect else "accept"


def make_parts(
    count: int, recipes: tuple[str, ...], rng: np.random.Generator, folder: Path
) -> list[ShiftPart]:
    """Return the parts of a shift, shuffled; at least one is defective and one a stranger.

    Parameters
    ----------
    count : of all parts; strangers are laid beside them
    recipes : in turn
    rng : draws
    folder : for the files
    """
    defective = set(rng.choice(count, max(1, round(DEFECT_SHARE * count)), replace=False).tolist())
    parts = []
    for number in range(count):
        name = recipes[number % len(recipes)]
        if number in defective:
            file, defect = spoil(name, rng, folder / f"{name}_{number}.stl")
        else:
            file, defect = ROOT / "recipes" / "parts" / f"{name}.stl", ""
        parts.append(ShiftPart(name, file, defect, radius_of(file)))
    for number in range(max(1, round(STRANGER_SHARE * count))):
        name = STRANGERS[number % len(STRANGERS)]
        file = folder / f"stranger_{name}.stl"
        Held.load(ROOT / "benchmarks/corner_parts" / f"{name}.csg.yaml").solid.mesh.export(file)
        parts.append(ShiftPart("", file, "", radius_of(file)))
    order = rng.permutation(len(parts))
    return [parts[k] for k in order]


def radius_of(file: Path) -> float:
    mesh = trimesh.load_mesh(file)
    return float(np.linalg.norm(mesh.vertices - mesh.center_mass, axis=1).max())


def spoil(name: str, rng: np.random.Generator, file: Path) -> tuple[Path, str]:
    """Write a recipe's part with a groove in an inspected plane; return file and words.

    The groove is 22 mm long (or as long as the face allows), 3 mm wide and 1.5 mm deep: a recipe
    has to find what is 3 mm.
    """
    recipe_file = ROOT / "recipes" / f"{name}.yaml"
    held = Held.load(ROOT / "recipes" / "parts" / f"{name}.stl")
    solid = held.solid
    left_out = faces_left_out(
        recipe_file, load_recipe(recipe_file), solid.faces, find_features(solid)
    )
    planes = [f for f in held.solid.faces if f.kind == "plane" and f.id not in left_out]
    planes = sorted(planes, key=lambda f: -f.area_mm2)[:3]
    face = planes[int(rng.integers(len(planes)))]
    mine = held.samples.points_mm[held.samples.face_ids == face.id]
    others = held.samples.points_mm[held.samples.face_ids != face.id]
    free_mm = np.array([np.linalg.norm(others - p, axis=1).min() for p in mine])
    good = np.flatnonzero(free_mm >= min(EDGE_MM, 0.95 * free_mm.max()))
    at = int(rng.choice(good))
    length_mm = min(22.0, 2.0 * max(float(free_mm[at]) - 1.0, 3.0))
    side = np.cross(face.normal, rng.normal(size=3))
    side /= np.linalg.norm(side)
    T = np.eye(4)
    T[:3, :3] = np.column_stack([side, np.cross(face.normal, side), face.normal])
    T[:3, 3] = mine[at]
    groove = Manifold.cube((length_mm, 3.0, 3.0), True).transform(T[:3])
    as_mesh(as_body(held.solid.mesh) - groove).export(file)
    return file, f"groove of {length_mm:.0f} x 3 x 1.5 mm in F{face.id}"


def is_on_table(x_mm: float, y_mm: float) -> bool:
    """Return whether a place is on the light table."""
    return all(low <= v <= high for v, (low, high) in zip((x_mm, y_mm), GLOWING_MM, strict=True))


def spots_for(parts: list[ShiftPart], rng: np.random.Generator) -> list[tuple[float, float] | None]:
    """Return where each part is dropped, apart from each other.

    Parameters
    ----------
    parts : to be dropped
    rng : draws

    Returns
    -------
    x and y [mm] of each; None where no room is left for it
    """
    found: list[tuple[float, float] | None] = []
    there: list[tuple[Array, float]] = []
    for part in parts:
        spot = None
        for _ in range(TRIES):
            at = np.array([rng.uniform(*low_high) for low_high in REACH_MM])
            is_inside = all(
                low + part.radius_mm <= x <= high - part.radius_mm
                for x, (low, high) in zip(at, SEEN_MM, strict=True)
            )
            if is_inside and all(math.dist(at, c) > r + part.radius_mm + GAP_MM for c, r in there):
                spot = (float(at[0]), float(at[1]))
                there.append((at, part.radius_mm))
                break
        found.append(spot)
    return found
