"""The library of possible parts, prepared for recognition.

A library of a thousand parts is searched by its views alone; meshes are needed only of the few
candidates in a picture, and are loaded then.
"""

from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from controller.arrays import Float32Array, FloatArray, square_to
from controller.cad import CadError, PartSymmetry, Solid, StablePose, camera_view, prepare_views
from controller.cad.compiled import CompiledPart
from controller.imaging import Camera, RayCaster

from ..fitting import EdgeModel, EdgeShape, FreeTurn, edge_model, edge_shape
from ..grey import EdgeletIndex, edgelet_index, view_edgelets
from ..stretches import ViewStretches, view_stretches
from ._index import ViewIndex
from ._views import CameraPlace, PartViews, pose_on_table, shadow_camera, view_part

MIN_PROBABILITY = 0.01
KEPT_MODELS = 32  # models in memory; each takes some megabytes with its search tree
UPRIGHT_RAD = np.radians(1.0)


@dataclass(frozen=True, eq=False, slots=True)
class LibraryPart:
    """One part of a library: the data kept in memory for it.

    Attributes
    ----------
    name : name of the part
    poses : the stable poses it may be found in; of those that a symmetry makes the same, the first
    turns_rad : turns about the vertical that leave each pose unchanged, 0 first; empty if any turn
        does
    centroid_mm : (3,) centre of mass, CAD frame
    extent_mm : its longest side
    views : views of these poses
    edgelets : `view_edgelets` of each of these poses, at turn 0 straight below the camera
    rolls : the axis about which the part lies at any turn in each of these poses; None where it
        does not roll about one, or where it is round about that
    """

    name: str
    poses: tuple[StablePose, ...]
    turns_rad: tuple[FloatArray, ...]
    centroid_mm: FloatArray
    extent_mm: float
    views: PartViews
    edgelets: tuple[Float32Array, ...]
    rolls: tuple[FreeTurn | None, ...]

    def pose(self, index: int) -> StablePose:
        """Return the pose of an index."""
        return next(pose for pose in self.poses if pose.index == index)

    def turns_of(self, index: int) -> FloatArray:
        """Return the turns that leave a pose unchanged."""
        return self.turns_rad[self._at(index)]

    def roll_of(self, index: int) -> FreeTurn | None:
        """Return the axis about which the part may lie at any turn in a pose."""
        return self.rolls[self._at(index)]

    def _at(self, index: int) -> int:
        return next(i for i, pose in enumerate(self.poses) if pose.index == index)


class Library:
    """Parts with the index of their views.

    Parameters
    ----------
    entries : the parts
    load : gives what the edges of an entry are made from, by its number
    load_solid : gives the part itself, for whoever wants to draw it
    eye_mm : (3,) the camera's centre in the world
    """

    def __init__(
        self,
        entries: Sequence[LibraryPart],
        load: Callable[[int], EdgeShape],
        load_solid: Callable[[int], Solid],
        eye_mm: FloatArray,
    ) -> None:
        self.entries = tuple(entries)
        self.index = ViewIndex([entry.views for entry in self.entries], eye_mm)
        self.eye_mm = np.asarray(eye_mm, dtype=np.float64)
        self._load = load
        self.solid = load_solid
        self._models: OrderedDict[int, EdgeModel] = OrderedDict()

    @cached_property
    def stretches(self) -> tuple[ViewStretches, ...]:
        """Stretches of the outlines of the index' views by length, for outlines known in part."""
        return view_stretches(self.index.outer_mm)

    @cached_property
    def edgelets(self) -> EdgeletIndex:
        """Edgelets of all poses of all parts, in the order of ``edgelet_views``."""
        return edgelet_index([view for entry in self.entries for view in entry.edgelets])

    @cached_property
    def edgelet_views(self) -> tuple[tuple[int, int], ...]:
        """Part and pose of each view of ``edgelets``."""
        return tuple(
            (number, pose.index)
            for number, entry in enumerate(self.entries)
            for pose in entry.poses
        )

    @cached_property
    def edgelet_turns_rad(self) -> FloatArray:
        """Smallest turn of each of ``edgelet_views`` that leaves it as it is; 0 if any does."""
        turns = [self.entries[part].turns_of(pose) for part, pose in self.edgelet_views]
        return np.array([2 * np.pi / len(kept) if len(kept) else 0.0 for kept in turns])

    def model(self, part: int) -> EdgeModel:
        """Return the edges of a part, from memory if they were used lately."""
        found = self._models.pop(part, None) or edge_model(self._load(part))
        self._models[part] = found
        if len(self._models) > KEPT_MODELS:
            self._models.popitem(last=False)
        return found


def station_of(camera: Camera) -> CameraPlace:
    """Return a camera's height and the radius of the table that it sees from there.

    Rounded, so that a new calibration of the same camera does not void earlier results.
    """
    width, height = camera.size_px
    corners = np.array([[0, 0], [width, 0], [0, height], [width, height]], dtype=np.float64)
    eye = camera.position_mm
    reach = np.linalg.norm(camera.on_plane(corners)[:, :2] - eye[:2], axis=1).max()
    return CameraPlace(
        eye_mm=float(10 * np.round(eye[2] / 10)), reach_mm=float(20 * np.ceil(reach / 20))
    )


def make_entry(
    part: CompiledPart, station: CameraPlace, min_probability: float = MIN_PROBABILITY
) -> tuple[LibraryPart, EdgeShape]:
    """Return the library's entry for a part, and the shape from which its edges are made.

    Parameters
    ----------
    part : compiled
    station : position of the camera
    min_probability : stable poses that are rarer are left out

    Raises
    ------
    CadError : it is too tall to lie under the camera
    """
    poses = _distinct_poses(part.poses, min_probability)
    shape = edge_shape(part.solid)
    try:
        views = view_part(part.solid, poses, RayCaster(part.solid.mesh), station)
    except ValueError as error:
        raise CadError(f"{error}; use another camera or a smaller part") from error
    turns = tuple(turns_that_keep(pose.R, part.symmetry) for pose in poses)
    centroid = np.asarray(part.solid.centroid_mm, dtype=np.float64)
    edgelets = tuple(_edgelets(part.solid, pose, station) for pose in poses)
    extent = float(part.solid.mesh.extents.max())
    rolls = tuple(_roll(part, pose) for pose in poses)
    name = part.solid.name
    return LibraryPart(name, poses, turns, centroid, extent, views, edgelets, rolls), shape


def _roll(part: CompiledPart, pose: StablePose) -> FreeTurn | None:
    """Return the axis about which a part rolls in a pose, unless it is round about that."""
    family = next((one for one in part.resting.families if one.pose == pose.index), None)
    if family is None or family.kind == "ball":
        return None
    same_rad = turns_that_keep(np.stack([*square_to(family.axis), family.axis]), part.symmetry)
    return FreeTurn(family.axis, family.centre_mm, same_rad) if len(same_rad) else None


def _edgelets(solid: Solid, pose: StablePose, station: CameraPlace) -> Float32Array:
    """Return the edgelets of a pose straight below the camera, in mm on the table."""
    eye = station.eye_mm
    above = shadow_camera(np.array([0.0, 0.0, eye]))
    T = pose_on_table(solid, pose, 0.0, 0.0, 0.0)
    return view_edgelets(camera_view(solid, T, above, prepared=prepare_views(solid)), T, eye)


def _distinct_poses(poses: Sequence[StablePose], least: float) -> tuple[StablePose, ...]:
    """Return the poses that may occur, one of those that look alike by symmetry.

    Symmetric stable poses share one probability, so that the sum of theirs counts.
    """
    probability: dict[int, float] = {}
    for pose in poses:
        total = probability.get(pose.first_alike, 0.0)
        probability[pose.first_alike] = total + pose.probability
    # what would roll on or tip at a touch is seen lying all the same; planning refuses it
    return tuple(p for p in poses if probability.get(p.index, 0.0) >= least)


def turns_that_keep(R: FloatArray, symmetry: PartSymmetry) -> FloatArray:
    """Return the turns about the vertical [rad] that leave a pose unchanged; empty if all do."""
    up = R[2]  # the vertical in the part's own axes
    if symmetry.is_ball:
        return np.zeros(0)
    if symmetry.axis is not None and abs(float(symmetry.axis @ up)) > np.cos(UPRIGHT_RAD):
        return np.zeros(0)
    found = []
    for kept in symmetry.rotations:
        turned = R @ kept @ R.T
        if turned[2, 2] > np.cos(UPRIGHT_RAD):
            found.append(float(np.arctan2(turned[1, 0], turned[0, 0])))
    if symmetry.axis is not None and _turns_over(symmetry, up):
        found.append(np.pi)
    found.sort(key=abs)
    return np.array(found or [0.0])


def _turns_over(symmetry: PartSymmetry, up: FloatArray) -> bool:
    """Return True if a round part on its side looks the same with its ends swapped.

    The half turn about the vertical is one that reverses the axis, and some turn about the axis.
    """
    assert symmetry.axis is not None
    is_level = abs(float(symmetry.axis @ up)) < np.sin(UPRIGHT_RAD)
    reverses = (symmetry.rotations @ symmetry.axis) @ symmetry.axis < -np.cos(UPRIGHT_RAD)
    return bool(is_level and reverses.any())


def make_library(
    parts: Sequence[CompiledPart], camera: Camera, min_probability: float = MIN_PROBABILITY
) -> Library:
    """Return a few parts prepared for a camera, all in memory.

    Parameters
    ----------
    parts : compiled; their order is that of the library's indices
    camera : overhead, calibrated
    min_probability : stable poses that are rarer are left out

    Raises
    ------
    CadError : a part is too large for the camera's picture
    """
    station = station_of(camera)
    made = [make_entry(part, station, min_probability) for part in parts]
    for entry, _ in made:
        check_fits(entry, camera)
    shapes = [shape for _, shape in made]
    solids = [part.solid for part in parts]
    return Library(
        [entry for entry, _ in made],
        shapes.__getitem__,
        solids.__getitem__,
        camera.position_mm,
    )


def check_fits(entry: LibraryPart, camera: Camera) -> None:
    """Require that a part fits into a camera's picture as it rests on the table.

    Raises
    ------
    CadError : it is longer than the longer side of the picture on the table
    """
    width, height = camera.size_px
    middle = camera.on_plane(np.array([[width / 2, height / 2]]))[0]
    side = camera.on_plane(np.array([[0.0, height / 2], [width / 2, 0.0]]))
    half = np.linalg.norm(side - middle, axis=1)
    if entry.extent_mm > 2 * float(half.max()):
        raise CadError(
            f"{entry.name}: {entry.extent_mm:.0f} mm long, it does not fit into the overhead "
            "camera's picture; use another camera or a smaller part"
        )


def place_of(entry: LibraryPart, T_world_part: FloatArray) -> FloatArray:
    """Return the position of a posed part's centre of mass over the table, (2,)."""
    at: FloatArray = (T_world_part[:3, :3] @ entry.centroid_mm + T_world_part[:3, 3])[:2]
    return at


def turn_of(R: FloatArray, T_world_part: FloatArray) -> float:
    """Return the turn about the vertical [rad] from a pose's ``R`` to a posed part."""
    turned = T_world_part[:3, :3] @ R.T
    return float(np.arctan2(turned[1, 0] - turned[0, 1], turned[0, 0] + turned[1, 1]))


def is_same_turn(a_rad: float, b_rad: float, turns_rad: FloatArray, within_rad: float) -> bool:
    """Return True if two turns are equal up to those that leave the pose unchanged.

    Parameters
    ----------
    a_rad, b_rad : about z, of any number of full turns
    turns_rad : (k,) turns that leave the pose as it is, 0 among them; empty if any does
    within_rad : difference below which they are one
    """
    if len(turns_rad) == 0:
        return True
    gap = (a_rad - b_rad - turns_rad + np.pi) % (2 * np.pi) - np.pi
    return bool(np.abs(gap).min() < within_rad)
