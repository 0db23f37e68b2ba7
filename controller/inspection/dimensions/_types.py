"""Inputs of a measurement, and prior knowledge of camera, light and part."""

from dataclasses import dataclass

from controller.arrays import BoolArray, FloatArray, Grey

from .._scene import ViewScene
from .._types import ViewPictures, ViewTask
from ..characteristics.limits.capability import EXPANSION_PER_K

BACKLIT = "backlit"


@dataclass(frozen=True, eq=False, slots=True)
class PosedView:
    """A view with its pictures, and the pose of the part in it.

    Attributes
    ----------
    task, pictures : the view, and its pictures
    T_world_part_measured : (4, 4)
    covariance : (6, 6) of the centre of mass's position, world [mm], and of the rotation vector
        about it, world [rad]
    grasp : number of the grasp; views with the same number share the error of their pose
    scene : scene without the part; None to derive it from the task
    passed : lamps whose pictures passed their self-checks, including `BACKLIT`; None for all
    counted : (s,) mask of the surface samples for which the view counts; None for all
    """

    task: ViewTask
    pictures: ViewPictures
    T_world_part_measured: FloatArray
    covariance: FloatArray
    grasp: int = 0
    scene: ViewScene | None = None
    passed: tuple[str, ...] | None = None
    counted: BoolArray | None = None

    @property
    def lamps(self) -> tuple[str, ...]:
        """Lamps of the pictures that count, including `BACKLIT`."""
        return (BACKLIT, *self.pictures.lit) if self.passed is None else self.passed

    def picture(self, lamp: str) -> Grey:
        """Return the picture under a lamp, or before the panel (`BACKLIT`)."""
        return self.pictures.backlit if lamp == BACKLIT else self.pictures.lit[lamp]


@dataclass(frozen=True, slots=True)
class MeasuringSettings:
    """Prior knowledge, and limits beyond which a measurement does not count.

    Uncertainties are standard ones. Those of light are half widths of a rectangular distribution
    over the square root of three: bright walls and broken edges displace an edge by up to 0.1 px
    before a panel and 0.12 px under a lamp. Of 193 looks at bores under a lamp, path-traced in four
    finishes, 90 % find the edge within 0.14 px, noise included.

    Attributes
    ----------
    backlit_edge_px, lit_edge_px : displacement of a whole edge by light
    unconfirmed_light : factor on it where there is only one look under a lamp
    lens_px : residual of the lens after calibration, between two places of a picture
    scale : relative error of the focal length and of the calibration artefact
    temperature_k : deviation of the part's temperature from 20 degrees Celsius
    expansion_per_k : expansion of its material; aluminium, which expands most of machined materials
    min_share : least share of the rays predicted to show the edge
    min_part : the same for an edge under a lamp whose rest is dark: enough for a value, but not for
        a verdict
    min_rays : least number of rays that determine a shape
    max_ray_px : largest standard error of a ray; beyond it there is no contrast against the noise
    min_contrast_share : least contrast as a share of that between panel and part; less is light
        reflected by a wall
    max_width_change : largest change of an edge's width against the picture's other edges
    width_px : narrowest and widest edge of a lens in focus
    max_form_px : largest scatter of edge points about the fitted shape, beyond their noise
    max_profile : largest deviation of a profile from a blurred step, as a share of its height,
        beyond three times the noise
    max_burnt : largest share of burnt-out samples
    independent_rad : least angle between two views that are independent looks; two lamps are too
    """

    backlit_edge_px: float = 0.1 / 3**0.5
    lit_edge_px: float = 0.12 / 3**0.5
    unconfirmed_light: float = 2.0
    lens_px: float = 0.1
    scale: float = 5e-5
    temperature_k: float = 5.0
    expansion_per_k: float = EXPANSION_PER_K
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
