"""All pictures of all boards -> the cell: bundle adjustment with priors, and its uncertainty.

Least squares by scipy over the unknowns of `layout`, in units of their prior spread. The prior
holds what the pictures do not show: base and zeros may share a turn, plate and jaws a shift. A
first fit is robust, so that no single picture drags it; then corners that contradict their own
board are left out, corner noise and joint noise are measured, and the last fit is plain least
squares, whose covariance is the normal matrix's inverse.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.optimize import least_squares

from controller.arrays import BoolArray, FloatArray
from controller.imaging import Camera
from messages import key, say

from ._types import BoardPicture, CellPrior, KinematicsError
from .layout import PictureTerms, UnknownsLayout
from .noise import (
    Whitening,
    corner_noise_px,
    in_line,
    joint_factor,
    whitening,
    within_picture,
)

_FIRST_NOISE_PX: Final = 1.0  # noise assumed in the first fit, whose start is tens of pixels off
_ROBUST_AT: Final = 4.0  # in these units a residual counts less than its square
_OUTLIER_SIGMA: Final = 5.0
# Where edges run along rows, the corners of one picture share errors of this size; a smaller figure
# would leave out the corners of such a picture one by one, until the rest of them tilts it.
_NOISE_MIN_PX: Final = 0.02
_CORNERS_MIN: Final = 6  # a picture with fewer determines a pose and checks nothing
_OBSERVED: Final = 0.5  # an unknown is observable if its spread shrinks to this share
_ROUNDS: Final = 3


@dataclass(frozen=True, slots=True, eq=False)
class PictureFit:
    """Agreement of one picture with the cell.

    Attributes
    ----------
    is_held : whether it shows the plate in the gripper
    used_count, outlier_count : numbers of its corners used and left out
    rms_px : rms distance of its used corners from their prediction
    own_rms_px : the same once its board may be anywhere: what the board itself does not explain
    off_sigma : distance of its board from the pose in the cell file, in standard deviations of six
        degrees of freedom; about 1 where all is well
    """

    name: str
    camera: str
    is_held: bool
    used_count: int
    outlier_count: int
    rms_px: float
    own_rms_px: float
    off_sigma: float


@dataclass(frozen=True, slots=True, eq=False)
class CellFit:
    """A cell as its pictures show it.

    Attributes
    ----------
    layout : names and meaning of the unknowns
    x, cov : (m,) and (m, m) the unknowns less their priors, and their covariance
    noise_px : standard deviation of a corner's u or v
    joint_std : (6,) standard deviations of the joints from stop to stop [rad, mm]
    used : masks of the corners used in each picture
    misfit : minus twice the logarithm of how likely the pictures are; less is better, by the same
        pictures
    """

    layout: UnknownsLayout
    x: FloatArray
    cov: FloatArray
    noise_px: float
    joint_std: FloatArray
    pictures: tuple[PictureFit, ...]
    used: tuple[BoolArray, ...]
    misfit: float

    @property
    def std(self) -> FloatArray:
        """Standard deviations (m,) of the unknowns."""
        out: FloatArray = np.sqrt(np.diag(self.cov))
        return out

    def value(self, name: str) -> tuple[float, float]:
        """Return one unknown's difference from its prior, and its standard deviation."""
        i = self.layout.index(name)
        return float(self.x[i]), float(self.std[i])

    def camera(self, name: str) -> Camera:
        """Return a calibrated camera; a moved one at its present pose."""
        return self.layout.camera(self.x, name, np.inf)

    def observed(self, off: FloatArray, jac: FloatArray) -> "CellFit":
        """Return the fit with more observations, to first order.

        Parameters
        ----------
        off : (k,) observed less predicted, in standard deviations of the observations
        jac : (k, m) derivatives of the predictions by the unknowns, in the same units
        """
        gain = self.cov @ jac.T @ np.linalg.inv(np.eye(len(off)) + jac @ self.cov @ jac.T)
        left = np.eye(len(self.x)) - gain @ jac
        return replace(self, x=self.x + gain @ off, cov=left @ self.cov @ left.T + gain @ gain.T)

    @property
    def T_world_arm(self) -> FloatArray:
        """The arm's base in the world (4, 4)."""
        return self.layout.T_world_arm(self.x)

    @property
    def arm(self) -> dict[str, float]:
        """The arm's figures by name."""
        names = [u.name for u in self.layout.prior.arm.unknowns]
        values = self.layout.arm_values(self.x)
        return dict(zip(names, (float(v) for v in values), strict=True))

    @property
    def observable(self) -> tuple[str, ...]:
        """Names of unknowns that the pictures determine clearly better than the prior."""
        shrunk = self.std < _OBSERVED * self.layout.std
        return tuple(n for n, ok in zip(self.layout.names, shrunk, strict=True) if ok)

    @property
    def held(self) -> tuple[str, ...]:
        """Names of the others: their prior holds them."""
        known = set(self.observable)
        return tuple(n for n in self.layout.names if n not in known)


def calibrate_cell(
    prior: CellPrior,
    pictures: Sequence[BoardPicture],
    *,
    bumped: Mapping[str, tuple[float, FloatArray]] | None = None,
    start: FloatArray | None = None,
) -> CellFit:
    """Return the cell that agrees best with all pictures.

    Parameters
    ----------
    prior : prior knowledge
    pictures : at least one of the board at its known place on the table
    bumped : cameras that moved meanwhile, as `UnknownsLayout`
    start : (m,) unknowns to begin with

    Raises
    ------
    KinematicsError : too few corners, nothing fixes the world, or no cell fits
    """
    _check(prior, pictures)
    layout = UnknownsLayout(prior, bumped)
    used = [np.ones(len(p.board.pixels), dtype=bool) for p in pictures]
    x = np.zeros(layout.size) if start is None else start
    x = _fit(layout, pictures, x, [Whitening(np.full(2 * len(u), 1.0)) for u in used], robust=True)
    noise_px, joint_std = _FIRST_NOISE_PX, np.zeros(6)
    for _ in range(_ROUNDS):
        terms = layout.evaluate(x, pictures)
        for _ in range(2):  # a gross corner hides a lesser one
            noise_px = max(_NOISE_MIN_PX, corner_noise_px(terms, used))
            used = [
                in_line(t, u, noise_px, _OUTLIER_SIGMA) for t, u in zip(terms, used, strict=True)
            ]
            _check_left(pictures, used)
        factor = joint_factor(terms, used, noise_px, prior.joint_std, layout.std, x)
        joint_std = factor * prior.joint_std
        white = [whitening(t, u, noise_px, joint_std) for t, u in zip(terms, used, strict=True)]
        before = x
        x = _fit(layout, pictures, x, white)
        if np.abs((x - before) / layout.std).max() < 1e-4:
            break
    terms = layout.evaluate(x, pictures)
    white = [whitening(t, u, noise_px, joint_std) for t, u in zip(terms, used, strict=True)]
    cov, misfit = _spread(layout, terms, white, x)
    misfit += 4.0 * float(np.log(noise_px)) * sum(int(u.sum()) for u in used)
    fits = tuple(
        _picture_fit(p, t, u, noise_px, joint_std)
        for p, t, u in zip(pictures, terms, used, strict=True)
    )
    return CellFit(layout, x, cov, noise_px, joint_std, fits, tuple(used), misfit)


def _check(prior: CellPrior, pictures: Sequence[BoardPicture]) -> None:
    for picture in pictures:
        count = len(picture.board.pixels)
        if count < _CORNERS_MIN:
            raise KinematicsError(
                say(
                    "{name} shows {count} corners of the board, {corners_min} are "
                    "required; take it again or leave it out",
                    name=picture.name,
                    count=count,
                    corners_min=_CORNERS_MIN,
                )
            )
    fixed = {name for name, placing in prior.placings.items() if placing.mm <= 0.0}
    if not any(p.q is None and p.held_as in fixed for p in pictures):
        raise KinematicsError(
            key(
                "no picture shows the board at its marked place, so nothing fixes the world; "
                "lay it there and take a picture with the overhead camera"
            )
        )
    seen = {p.camera for p in pictures}
    for name in prior.cameras:
        if name not in seen:
            raise KinematicsError(say("no picture of the camera {name} shows a board", name=name))


def _check_left(pictures: Sequence[BoardPicture], used: Sequence[BoolArray]) -> None:
    for picture, keep in zip(pictures, used, strict=True):
        if keep.sum() < _CORNERS_MIN:
            raise KinematicsError(
                say(
                    "{name}: {sum} of {keep_count} corners agree with each other; "
                    "check that the board is the one of the target file, flat and at "
                    "rest",
                    name=picture.name,
                    sum=int(keep.sum()),
                    keep_count=len(keep),
                )
            )


def _fit(
    layout: UnknownsLayout,
    pictures: Sequence[BoardPicture],
    x0: FloatArray,
    white: Sequence[Whitening],
    *,
    robust: bool = False,
) -> FloatArray:
    """Return the unknowns (m,) of least squares from x0."""
    total = sum(len(w.weights) for w in white)
    at_x: dict[bytes, tuple[FloatArray, FloatArray]] = {}

    def evaluated(y: FloatArray) -> tuple[FloatArray, FloatArray]:
        key = y.tobytes()
        if key not in at_x:  # the solver calls for residuals and Jacobian one after the other
            at_x.clear()
            at_x[key] = stacked(layout, layout.evaluate(y * layout.std, pictures), white, y)
        return at_x[key]

    def residuals(y: FloatArray) -> FloatArray:
        return evaluated(y)[0]

    def slopes(y: FloatArray) -> FloatArray:
        return evaluated(y)[1]

    def loss(z: FloatArray) -> FloatArray:
        """Return scipy's rho, rho' and rho'' of squared residuals; the prior stays Gaussian."""
        rho = np.array([z, np.ones_like(z), np.zeros_like(z)])
        far = z > _ROBUST_AT**2
        far[total:] = False
        root = np.sqrt(z[far])
        rho[:, far] = (
            2 * _ROBUST_AT * root - _ROBUST_AT**2,
            _ROBUST_AT / root,
            -_ROBUST_AT / (2 * root**3),
        )
        return rho

    found = least_squares(
        residuals,
        x0 / layout.std,
        jac=slopes,
        method="trf",
        loss=loss if robust else "linear",  # type: ignore[arg-type]  # stubs want a protocol's name
        xtol=1e-7,
        ftol=1e-8,
        gtol=None,
        max_nfev=60,
    )
    out: FloatArray = found.x * layout.std
    return out


def stacked(
    layout: UnknownsLayout, terms: Sequence[PictureTerms], white: Sequence[Whitening], y: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return all residuals (n,) and their Jacobian (n, m) by x in units of its prior spread.

    Parameters
    ----------
    layout : layout of the unknowns
    terms, white : of all pictures
    y : (m,) the unknowns in these units; the last m residuals are the prior's
    """
    total = sum(len(w.weights) for w in white)
    r = np.empty(total + layout.size)
    jac = np.zeros((total + layout.size, layout.size))
    row = 0
    for one, w in zip(terms, white, strict=True):
        rows = slice(row, row + len(w.weights))
        row = rows.stop
        r[rows] = w.apply(one.residual_px.ravel())
        by = w.apply(one.by_unknowns.reshape(len(w.weights), -1))
        jac[rows, one.columns] = by * layout.std[one.columns]
    r[total:] = y
    jac[total:] = np.eye(layout.size)
    return r, jac


def _spread(
    layout: UnknownsLayout, terms: Sequence[PictureTerms], white: Sequence[Whitening], x: FloatArray
) -> tuple[FloatArray, float]:
    """Return the covariance (m, m) of the unknowns, and the misfit but for the corners' noise."""
    r, jac = stacked(layout, terms, white, x / layout.std)
    normal = jac.T @ jac
    misfit = float(r @ r) + float(np.linalg.slogdet(normal)[1]) + sum(w.log_det for w in white)
    return np.linalg.inv(normal) * np.outer(layout.std, layout.std), misfit


def _picture_fit(
    picture: BoardPicture,
    terms: PictureTerms,
    used: BoolArray,
    noise_px: float,
    joint_std: FloatArray,
) -> PictureFit:
    white = whitening(terms, used, noise_px, joint_std)
    r = white.apply(terms.residual_px.ravel())
    along, _ = np.linalg.qr(white.apply(terms.by_board.reshape(len(r), -1)))
    off = float(np.linalg.norm(along.T @ r) / np.sqrt(along.shape[1]))

    def rms(values: FloatArray) -> float:
        return float(np.sqrt((values[used] ** 2).sum(axis=1).mean()))

    return PictureFit(
        picture.name,
        picture.camera,
        picture.q is not None,
        int(used.sum()),
        int((~used).sum()),
        rms(terms.residual_px),
        rms(within_picture(terms, used)),
        off,
    )
