"""Inputs of measuring, and knowledge of camera, light and part before a picture."""

from dataclasses import dataclass

from controller.arrays import FloatArray, Grey

from .._scene import ViewScene
from .._types import ViewPictures, ViewTask

BACKLIT = "backlit"


@dataclass(frozen=True, eq=False, slots=True)
class PosedView:
    """A view with its pictures, and the pose of the part in it.

    Attributes
    ----------
    task, pictures : the view, and what was taken there
    T_world_part : (4, 4) measured
    covariance : (6, 6) of the centre of mass's position, world [mm], and of the rotation vector
        about it, world [rad]
    grasp : views with the same number share the error of their pose
    scene : what stands there; None to find it from the task
    """

    task: ViewTask
    pictures: ViewPictures
    T_world_part: FloatArray
    covariance: FloatArray
    grasp: int = 0
    scene: ViewScene | None = None

    def picture(self, lamp: str) -> Grey:
        """Return the picture under a lamp, or before the panel (`BACKLIT`)."""
        return self.pictures.backlit if lamp == BACKLIT else self.pictures.lit[lamp]


@dataclass(frozen=True, slots=True)
class MeasuringSettings:
    """Knowledge before a picture, and limits beyond which a measurement does not count.

    Uncertainties are standard ones. The light's are halves of a rectangle over the square root of
    three, of an edge that may show 0.1 px beside its place before a panel, 0.12 px under a lamp, as
    bright walls and broken edges make it: of 193 looks at bores under a lamp, path-traced in four
    finishes, 90 % find the edge within 0.14 px, noise and all.

    Attributes
    ----------
    backlit_edge_px, lit_edge_px : how far light moves an edge as a whole
    unconfirmed_light : times so much, where one look under a lamp is all there is
    lens_px : what calibration leaves of the lens, between two places of a picture
    scale : relative, of the focal length and of the artefact it was calibrated with
    temperature_k : of the part, against 20 degrees Celsius
    expansion_per_k : of its material; aluminium, which expands most of what is machined
    min_share : of the rays that were predicted to show the edge
    min_part : the same of an edge under a lamp whose rest no light shows: enough for a value, and
        not to decide upon it
    min_rays : fewer show no shape
    max_ray_px : a ray whose standard error is larger has no contrast against the noise
    min_contrast_share : of panel against part; less is light that a wall throws back
    max_width_change : of an edge against the picture's other edges
    width_px : the narrowest and the widest edge a lens in focus makes
    max_form_px : by which edge points may scatter about the fitted shape, beyond their noise
    max_profile : how far a profile may be off a blurred step, share of its height, beyond
        three times the noise
    max_burnt : share of burnt out samples
    independent_rad : two views so far apart, or two lamps, are two looks
    """

    backlit_edge_px: float = 0.1 / 3**0.5
    lit_edge_px: float = 0.12 / 3**0.5
    unconfirmed_light: float = 2.0
    lens_px: float = 0.1
    scale: float = 5e-5
    temperature_k: float = 5.0
    expansion_per_k: float = 23e-6
    min_share: float = 0.8
    min_part: float = 0.5
    min_rays: int = 12
    max_ray_px: float = 0.25
    min_contrast_share: float = 0.5
    max_width_change: float = 0.3
    width_px: tuple[float, float] = (0.35, 2.5)
    max_form_px: float = 0.25
    max_profile: float = 0.05
    max_burnt: float = 0.01
    independent_rad: float = 0.2618
