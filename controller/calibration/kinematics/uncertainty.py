"""Uncertainty of a calibrated cell's TCP: in the world, and for its cameras.

The full covariance of the fit is propagated, so that quantities fixed jointly by the pictures count
as such: base and shoulder may share a turn that nothing shows, without any effect on the TCP.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import gammaincinv

from controller.arrays import FloatArray
from controller.imaging import inverse_pose, transform

from .layout import POSE
from .solve import CellFit

_WITHIN: Final = 0.95
_STEP: Final = 1e-4  # step of central differences, in standard deviations of the prior
_RELEVANT: Final = ("base", "arm")


@dataclass(frozen=True, slots=True, eq=False)
class PoseUncertainty:
    """Standard uncertainties of one pose; twice of them holds 95 %.

    Attributes
    ----------
    cov : (6, 6) covariance of rotation [rad] and position [mm], in world axes
    u_mm, u_rad : half the radius within which position and orientation are with 95 %
    """

    cov: FloatArray
    u_mm: float
    u_rad: float


def radius_u(cov: FloatArray) -> float:
    """Return half the radius that holds 95 % of a normal vector of covariance (n, n).

    Its squared length is taken as a scaled chi-square of the same mean and variance.
    """
    size = np.clip(np.linalg.eigvalsh(cov), 0.0, None)
    total, square = float(size.sum()), float((size**2).sum())
    if square == 0.0:
        return 0.0
    freedom = total**2 / square
    within = 2 * gammaincinv(freedom / 2, _WITHIN)  # of a chi-square
    return 0.5 * float(np.sqrt(total / freedom * within))


def tcp_poses(fit: CellFit, q: FloatArray, x: FloatArray | None = None) -> FloatArray:
    """Return T_world_tcp (n, 4, 4).

    Parameters
    ----------
    fit : fit of the cell
    q : (n, 6) joints
    x : (m,) unknowns in place of the fit's
    """
    at = fit.x if x is None else x
    layout = fit.layout
    out: FloatArray = layout.T_world_arm(at) @ layout.prior.arm.tcp(q, layout.arm_values(at))
    return out


def tcp_uncertainty(fit: CellFit, q: FloatArray) -> tuple[PoseUncertainty, ...]:
    """Return the uncertainty of the TCP's pose in the world at joints (n, 6)."""
    jac = _tcp_derivatives(fit, q)
    cov = jac @ fit.cov @ jac.transpose(0, 2, 1)
    return tuple(PoseUncertainty(c, radius_u(c[3:, 3:]), radius_u(c[:3, :3])) for c in cov)


def aim_uncertainty_mm(fit: CellFit, camera: str, q: FloatArray) -> FloatArray:
    """Return the standard uncertainty (n,) between a camera and the TCP, across its sight line.

    A pick goes to the position that the overhead camera measured, and a view puts the part before
    the inspection camera. Either way the error is the distance of the TCP from its predicted pixel,
    lens included.

    Parameters
    ----------
    fit : fit of the cell
    camera : by name
    q : (n, 6) joints
    """
    layout, eye = fit.layout, fit.camera(camera)
    T_cam_world = inverse_pose(eye.T_world_cam)
    p_world = tcp_poses(fit, q)[:, :3, 3]
    depth = transform(T_cam_world, p_world)[:, 2]
    focal = np.array([eye.K[0, 0], eye.K[1, 1]])

    def pixels(x: FloatArray) -> FloatArray:
        return layout.camera(x, camera, np.inf).project(tcp_poses(fit, q, x)[:, :3, 3])

    jac = np.zeros((len(q), 2, layout.size))
    keys = [f"{camera}.lens", camera, *_RELEVANT]
    if camera in layout.bumped:
        keys.append(f"{camera}.bump")
    for key in keys:
        at = layout.where(key)
        for i in range(at.start, at.stop):
            d = np.zeros(layout.size)
            d[i] = _STEP * layout.std[i]
            jac[:, :, i] = (pixels(fit.x + d) - pixels(fit.x - d)) / (2.0 * d[i])
    cov = jac @ fit.cov @ jac.transpose(0, 2, 1)
    scale = depth[:, None] / focal
    return np.array(
        [radius_u(c * np.outer(s, s)) for c, s in zip(cov, scale, strict=True)], dtype=np.float64
    )


def camera_uncertainty(fit: CellFit, camera: str, points_mm: FloatArray) -> FloatArray:
    """Return the uncertainty of a camera's points across its sight line (n,) [mm].

    Lens and pose vary together, by their covariance; half the radius that holds 95 %.

    Parameters
    ----------
    fit : fit of the cell
    camera : by name
    points_mm : (n, 3) in the world
    """
    layout, eye = fit.layout, fit.camera(camera)
    depth = transform(inverse_pose(eye.T_world_cam), points_mm)[:, 2]
    jac = np.zeros((len(points_mm), 2, layout.size))
    for key in (f"{camera}.lens", camera):
        at = layout.where(key)
        for i in range(at.start, at.stop):
            d = np.zeros(layout.size)
            d[i] = _STEP * layout.std[i]
            ahead = layout.camera(fit.x + d, camera, np.inf).project(points_mm)
            behind = layout.camera(fit.x - d, camera, np.inf).project(points_mm)
            jac[:, :, i] = (ahead - behind) / (2.0 * d[i])
    cov = jac @ fit.cov @ jac.transpose(0, 2, 1)
    scale = depth[:, None] / np.array([eye.K[0, 0], eye.K[1, 1]])
    return np.array(
        [radius_u(c * np.outer(s, s)) for c, s in zip(cov, scale, strict=True)], dtype=np.float64
    )


def repeatability_mm(fit: CellFit, q: FloatArray) -> float:
    """Return the standard uncertainty between the TCP and itself at another stop [mm].

    It follows from the joints' noise that the pictures show; the worst of joints (n, 6).
    """
    _, by = fit.layout.arm_derivatives(fit.x, q)
    joints = np.moveaxis(by[-6:, :, :3, 3], 0, -1) * fit.joint_std
    return max(radius_u(j @ j.T) for j in joints)


def _tcp_derivatives(fit: CellFit, q: FloatArray) -> FloatArray:
    """Return derivatives (n, 6, m) of the TCP's rotation vector and position by the unknowns."""
    layout = fit.layout
    jac = np.zeros((len(q), len(POSE), layout.size))
    R = tcp_poses(fit, q)[:, :3, :3]
    for key in _RELEVANT:
        at = layout.where(key)
        for i in range(at.start, at.stop):
            d = np.zeros(layout.size)
            d[i] = _STEP * layout.std[i]
            by = (tcp_poses(fit, q, fit.x + d) - tcp_poses(fit, q, fit.x - d)) / (2.0 * d[i])
            spin = by[:, :3, :3] @ R.transpose(0, 2, 1)  # skew symmetric
            jac[:, :3, i] = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
            jac[:, 3:, i] = by[:, :3, 3]
    return jac
