"""Inputs and results of the fit of a grasp."""

from dataclasses import dataclass

import numpy as np

from controller.arrays import BoolArray, FloatArray
from controller.imaging import Camera
from controller.recognition.fitting import OutlineMeasure

from ._rims import Rims


@dataclass(frozen=True, slots=True)
class PoseSettings:
    """Knowledge of arm, parts and light before a picture; all are standard deviations.

    Attributes
    ----------
    view_mm, view_rad : how far the arm is off from view to view, the part held the same
    face_mm : how far a face of a good part is from where the CAD model has it
    light_px : how far light that a wall throws back moves a whole edge in a backlit picture
    """

    view_mm: float = 0.1
    view_rad: float = float(np.radians(0.1))
    face_mm: float = 0.05
    light_px: float = 0.15


@dataclass(frozen=True, eq=False, slots=True)
class OutlineView:
    """One view of a part, with the data for its pose.

    Attributes
    ----------
    view_id, camera : which, and the camera
    T_world_part : (4, 4) where the kinematics have the part
    outline : observed before the panel
    noise_px : standard deviation of one of its points
    prior_mm, prior_rad : standard deviations of the expected pose
    """

    view_id: str
    camera: Camera
    T_world_part: FloatArray
    outline: OutlineMeasure
    noise_px: float
    prior_mm: float = 1.5
    prior_rad: float = 0.03


@dataclass(frozen=True, eq=False, slots=True)
class ViewPose:
    """Pose of the part in one view, and the agreement of its outline.

    Attributes
    ----------
    view_id : which
    T_world_part : (4, 4)
    covariance : (6, 6) of the centre of mass's position, world [mm], and of the rotation vector
        about it, world [rad]
    deviation_mm, deviation_rad : from where the grasp's pose has the part in this view
    rims : the predicted outline, about one point a pixel
    gap_px : (n,) how far beyond it the observed outline is; nan where none is near
    left_px : (n,) what of that faces out of place do not explain
    edge_px : (n,) what of it an edge's points have in common, which light does too
    judged : (n,) the outline there is the part's own, and in sight
    step_px : between points
    px_per_mm : of the part
    noise_px : standard deviation of one point, from the picture's noise and the CAD's facets
    residual_px : robust standard deviation of what no edge has in common
    paired : share of the predicted outline, where it is judged, that is found within 2 px once
        faces are where they are
    """

    view_id: str
    T_world_part: FloatArray
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


@dataclass(frozen=True, eq=False, slots=True)
class FaceShift:
    """Displacement of a face from its place in the CAD model, as outlines show it.

    Attributes
    ----------
    face_id : which
    grown_mm, u_grown_mm : along its normals, out of the material, and the standard uncertainty
    moved_mm, covariance : (3,) of a curved face, CAD frame, and (3, 3); zeros for a plane
    point_count : outline points that show it
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
    views : in the order given; those in which no outline was found are left out
    missing : ids of the ones left out
    shift_mm, rotation_rad : (3,) from the expected pose, CAD frame: of the centre of mass, and the
        rotation vector
    covariance : (6, 6) of both
    faces : those that show in an outline
    """

    views: tuple[ViewPose, ...]
    missing: tuple[str, ...]
    shift_mm: FloatArray
    rotation_rad: FloatArray
    covariance: FloatArray
    faces: tuple[FaceShift, ...]

    def view(self, view_id: str) -> ViewPose | None:
        """Return the pose in a view, None where it was not found."""
        return next((v for v in self.views if v.view_id == view_id), None)
