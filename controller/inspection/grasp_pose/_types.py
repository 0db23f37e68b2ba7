"""Inputs and results of the fit of a grasp."""

from dataclasses import dataclass, replace

import numpy as np

from controller.arrays import BoolArray, FloatArray
from controller.recognition.fitting import OutlineMeasure

from .._scene import ViewScene
from .._types import PicturedView, ViewTask
from ._backlit import Backlit
from ._rims import Rims


@dataclass(frozen=True, slots=True)
class PoseSettings:
    """Prior knowledge of arm, parts and light; all values are standard deviations.

    Attributes
    ----------
    view_mm, view_rad : error of the arm from view to view within a grasp
    face_mm : deviation of a good part's face from the CAD model
    light_px : displacement of a whole edge in a backlit picture by light reflected from a wall
    """

    view_mm: float = 0.1
    view_rad: float = float(np.radians(0.1))
    face_mm: float = 0.05
    light_px: float = 0.15


@dataclass(frozen=True, eq=False, slots=True)
class OutlinedView:
    """A view with the outline in its picture before the panel.

    Attributes
    ----------
    view : the view with its pictures
    scene : scene without the part
    backlit : outline observed before the panel
    """

    view: PicturedView
    scene: ViewScene
    backlit: Backlit

    @property
    def task(self) -> ViewTask:
        """The view: camera, pose expected, limits."""
        return self.view.task

    @property
    def outline(self) -> OutlineMeasure:
        """The outline observed."""
        return self.backlit.outline

    def turned(self, T_part_turned: FloatArray) -> "OutlinedView":
        """Return the view with the part expected at a turn (4, 4) from its pose."""
        T = self.task.T_world_part_expected @ T_part_turned
        return self.with_task(replace(self.task, T_world_part_expected=T))

    def with_task(self, task: ViewTask) -> "OutlinedView":
        """Return the view with another expectation of the same pictures."""
        return replace(self, view=replace(self.view, task=task))


@dataclass(frozen=True, eq=False, slots=True)
class ViewPose:
    """Pose of the part in one view, and the agreement of its outline.

    Attributes
    ----------
    view_id : name of the view
    T_world_part_measured : (4, 4)
    covariance : (6, 6) of the centre of mass's position, world [mm], and of the rotation vector
        about it, world [rad]
    deviation_mm, deviation_rad : deviation from the pose of the grasp in this view
    rims : predicted outline, about one point a pixel
    gap_px : (n,) distance of the observed outline beyond it; nan where none is near
    left_px : (n,) rest of that distance not explained by faces out of place
    edge_px : (n,) common offset of each edge's points, which light may cause too
    judged : (n,) mask of points where the outline belongs to the part and is in sight
    step_px : distance between points
    px_per_mm : scale at the part
    noise_px : standard deviation of one point, from the picture's noise and the CAD's facets
    residual_px : robust standard deviation after removal of the edges' common offsets
    paired : share of the judged predicted outline that is found within 2 px with the faces at their
        fitted places
    is_hidden : True if no picture before the panel could show the outline in this view; the pose is
        that of the grasp, within the error of the arm
    """

    view_id: str
    T_world_part_measured: FloatArray
    covariance: FloatArray
    deviation_mm: float
    deviation_rad: float
    rims: Rims
    gap_px: FloatArray
    left_px: FloatArray
    edge_px: FloatArray
    judged: BoolArray
    step_px: float
    px_per_mm: float
    noise_px: float
    residual_px: float
    paired: float
    is_hidden: bool = False


@dataclass(frozen=True, eq=False, slots=True)
class FaceShift:
    """Displacement of a face from its place in the CAD model, measured by outlines.

    Attributes
    ----------
    face_id : id of the face
    grown_mm, u_grown_mm : growth along its normals, out of the material; standard uncertainty
    moved_mm, covariance : (3,) shift of a curved face, CAD frame, and (3, 3); zeros for a plane
    point_count : number of outline points that show it
    """

    face_id: int
    grown_mm: float
    u_grown_mm: float
    moved_mm: FloatArray
    covariance: FloatArray
    point_count: int


@dataclass(frozen=True, eq=False, slots=True)
class GraspPose:
    """The pose of a part in the jaws, from all views of one grasp.

    Attributes
    ----------
    views : views in the given order; without those in which the outline should show and does not
    missing : ids of the views left out
    shift_mm, rotation_rad : (3,) shift of the centre of mass, and rotation vector, from the
        expected pose, CAD frame
    covariance : (6, 6) of both
    faces : faces visible in an outline
    """

    views: tuple[ViewPose, ...]
    missing: tuple[str, ...]
    shift_mm: FloatArray
    rotation_rad: FloatArray
    covariance: FloatArray
    faces: tuple[FaceShift, ...]

    def view(self, view_id: str) -> ViewPose | None:
        """Return the pose in a view; None if it was not found."""
        return next((v for v in self.views if v.view_id == view_id), None)
