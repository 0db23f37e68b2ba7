"""Faults behind pictures that contradict each other, by name.

A gross fault spreads over the whole fit: lenses, zeros and joint noise all absorb a part of it. So
each possible fault is fitted as well: prints with another size than in their files, a camera or a
plate that moved at some time. The one with the highest likelihood is named, if it is far likelier
and larger than the limits of a good cell.

A camera that moves between the pictures of the table and those of the plate looks like a print of
another size, unless the last picture shows the board on the table once more.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import degrees, radians
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.imaging import Camera
from messages import say

from ..camera import FoundBoard
from ._types import BoardPicture, CellPrior, KinematicsError
from .layout import PictureTerms, UnknownsLayout
from .noise import whitening
from .play import Play
from .solve import CellFit, calibrate_cell, stacked

_LIKELIER: Final = 30.0  # in the logarithm's units: odds of a million to one
# standard deviation of the faults that occur
_LOOSE_SCALE: Final = 0.02
_LOOSE_MOVE: Final = np.array([radians(0.5)] * 3 + [4.0] * 3)
_LOOSE_JOINTS: Final = 3.0  # in multiples of the noise that counters leave
_CORNERS_MIN: Final = 12  # least corners of a board, in both of two pictures
_PICTURES_MIN: Final = 3  # least pictures before and after a move; fewer could be chance


@dataclass(frozen=True, slots=True)
class FaultLimits:
    """Limits that a good cell stays below, each with its reason."""

    scale: float = 0.002  # scale error of a print; a ruler shows 0.0003
    other_board: float = 0.04  # no printer is off by this much: it is another board's file
    moved_mm: float = 0.5  # motion of a camera or plate; less is found in the residuals as noise
    moved_rad: float = radians(0.1)
    # scale of a board put at its mark again; only the camera changes it
    again_scale: float = 0.0005
    play_rad: float = radians(0.5)  # play of worn gears; sound ones have 0.1 to 0.3 degrees
    prior_sigma: float = 2.6  # distance of an unknown from its drawing, where a bound is at 1.7
    picture_ratio: float = 4.0  # residual of one picture against the median of all


@dataclass(frozen=True, slots=True)
class KinematicsFault:
    """Something wrong.

    Attributes
    ----------
    kind : board_scaled, board_file, camera_moved, plate_slipped, backlash, out_of_bounds, picture
    subject : board, camera, motor, unknown or picture concerned
    message : fault, amount, limit, and what to do
    """

    kind: str
    subject: str
    message: str


def find_faults(
    prior: CellPrior,
    pictures: Sequence[BoardPicture],
    fit: CellFit,
    *,
    play: Mapping[str, Play] | None = None,
    limits: FaultLimits = FaultLimits(),
) -> tuple[KinematicsFault, ...]:
    """Return the faults, causes before consequences; empty where all is well.

    Parameters
    ----------
    prior, pictures, fit : inputs and result of the calibration
    play : play of each motor's gears, if measured
    limits : limits that a good cell stays below
    """
    found = _backlash(play or {}, limits)
    cause = _likeliest(prior, pictures, fit, limits)
    if cause:
        return (*found, *cause)
    return (*found, *_odd_pictures(fit, limits), *_out_of_bounds(fit, limits))


@dataclass(frozen=True, slots=True)
class BoardAgain:
    """The board at its mark, seen at the beginning and at the end.

    Attributes
    ----------
    moved_mm, turned_rad : shift and turn of the print on the table
    grown : growth of its size, as a share
    fault : the camera was moved, None if neither is more than pins explain
    """

    moved_mm: float
    turned_rad: float
    grown: float
    fault: KinematicsFault | None


def board_again(
    camera: Camera,
    name: str,
    first: FoundBoard,
    again: FoundBoard,
    height_mm: float,
    limits: FaultLimits = FaultLimits(),
) -> BoardAgain:
    """Return the shift that a camera sees in a board that was put back at its mark.

    Parameters
    ----------
    camera : rough pose of the camera
    name : name for the message
    first, again : the board in both pictures
    height_mm : height of its print over the table
    limits : limits that a good cell stays below

    Raises
    ------
    KinematicsError : the pictures have too few corners in common
    """
    known = {tuple(np.round(xy, 3)): i for i, xy in enumerate(first.board_mm)}
    pairs = [
        (known[key], i)
        for i, xy in enumerate(again.board_mm)
        if (key := tuple(np.round(xy, 3))) in known
    ]
    if len(pairs) < _CORNERS_MIN:
        raise KinematicsError(
            say(
                "{name}: the board at its mark shows {pairs_count} corners in both "
                "pictures, {corners_min} are required; take away what covers it",
                name=name,
                pairs_count=len(pairs),
                corners_min=_CORNERS_MIN,
            )
        )
    here, there = np.array(pairs).T
    before = camera.on_plane(first.pixels[here], height_mm)[:, :2] @ (1.0, 1j)
    after = camera.on_plane(again.pixels[there], height_mm)[:, :2] @ (1.0, 1j)
    moved_mm = float(abs(after.mean() - before.mean()))
    x, y = before - before.mean(), after - after.mean()
    turn = np.vdot(x, y) / np.vdot(x, x).real  # least squares of y = turn * x
    turned, grown = float(abs(np.angle(turn))), float(abs(turn) - 1.0)
    is_moved = (
        moved_mm > limits.moved_mm or turned > limits.moved_rad or abs(grown) > limits.again_scale
    )
    fault = None
    if is_moved:
        fault = KinematicsFault(
            "camera_moved",
            name,
            say(
                "the camera {name} was moved while pictures were taken: it sees "
                "the board at its mark {moved_mm:.1f} mm and {turned_deg:.2f} deg from "
                "where it saw it first, and {grown_percent:+.2f} % larger ({allowed_mm:g} "
                "mm, {allowed_deg:.1f} deg, {allowed_percent:g} % are allowed). Screw it "
                "tight, see that the board lies at its pins, repeat the step",
                name=name,
                moved_mm=moved_mm,
                turned_deg=degrees(turned),
                grown_percent=100 * grown,
                allowed_mm=limits.moved_mm,
                allowed_deg=degrees(limits.moved_rad),
                allowed_percent=100 * limits.again_scale,
            ),
        )
    return BoardAgain(moved_mm, turned, grown, fault)


def _backlash(play: Mapping[str, Play], limits: FaultLimits) -> tuple[KinematicsFault, ...]:
    return tuple(
        KinematicsFault(
            "backlash",
            motor,
            say(
                "the gears of {motor} have {rad:.2f} deg of play, {play_rad:.2f} "
                "deg are allowed; tighten or replace them",
                motor=motor,
                rad=degrees(one.rad),
                play_rad=degrees(limits.play_rad),
            ),
        )
        for motor, one in play.items()
        if one.rad - 2.0 * one.u_rad > limits.play_rad
    )


def _likeliest(
    prior: CellPrior, pictures: Sequence[BoardPicture], fit: CellFit, limits: FaultLimits
) -> tuple[KinematicsFault, ...]:
    """Return the fault that explains the pictures far better than none, and best of all."""
    rivals: list[tuple[float, tuple[KinematicsFault, ...]]] = []
    for attempt in (_scaled, _camera_moved, _slipped):
        try:
            rivals += attempt(prior, pictures, fit, limits)
        except KinematicsError:  # a hypothesis that fits nothing is none
            continue
    likely = [(misfit, faults) for misfit, faults in rivals if misfit < fit.misfit - _LIKELIER]
    return min(likely, key=lambda one: one[0])[1] if likely else ()


def _scaled(
    prior: CellPrior, pictures: Sequence[BoardPicture], fit: CellFit, limits: FaultLimits
) -> list[tuple[float, tuple[KinematicsFault, ...]]]:
    """Return the likelihood of the pictures with prints of any size, and the prints that are wrong.

    A whole cell that is enlarged looks the same to its cameras: only the arm, whose lengths and
    travel are known, reveals it.
    """
    helped = [
        _helped(fit, pictures, [i for i, p in enumerate(pictures) if p.face == name], columns)
        for name, columns in ((n, fit.layout.where(f"{n}.print")) for n in prior.faces)
    ]
    if not _is_loose(fit) and max(h.gain for h in helped) < _LIKELIER:
        return []
    loose = {name: replace(face, scale=_LOOSE_SCALE) for name, face in prior.faces.items()}
    free = calibrate_cell(replace(prior, faces=loose), pictures, start=fit.x)
    faults = []
    for name in prior.faces:
        scale, std = free.value(f"{name}.print.scale")
        if abs(scale) < limits.scale + 2.0 * std:
            continue
        if abs(scale) > limits.other_board:
            faults.append(
                KinematicsFault(
                    "board_file",
                    name,
                    say(
                        "the squares of {name} are {scale:.3f} times as large as its file "
                        "has them; that is another board's file",
                        name=name,
                        scale=1 + scale,
                    ),
                )
            )
        else:
            faults.append(
                KinematicsFault(
                    "board_scaled",
                    name,
                    f"the print {name} is {100 * abs(scale):.2f} % too "
                    f"{'large' if scale > 0 else 'small'} for its file, "
                    f"{100 * limits.scale:g} % is allowed; measure it and enter its size",
                )
            )
    return [(free.misfit, tuple(faults))] if faults else []


def _camera_moved(
    prior: CellPrior, pictures: Sequence[BoardPicture], fit: CellFit, limits: FaultLimits
) -> list[tuple[float, tuple[KinematicsFault, ...]]]:
    """Return the likelihood of the pictures if a camera moved at the likeliest time, for each."""
    out: list[tuple[float, tuple[KinematicsFault, ...]]] = []
    for camera in prior.cameras:
        columns = fit.layout.where(camera)
        own = [i for i, p in enumerate(pictures) if p.camera == camera]
        helped = _helped(fit, pictures, own, columns)
        if not helped.is_worth(fit):
            continue
        taken_s = helped.since_s
        moved = calibrate_cell(prior, pictures, bumped={camera: (taken_s, _LOOSE_MOVE)})
        by = moved.x[moved.layout.where(f"{camera}.bump")]
        fault = _moved("camera_moved", camera, by, _named(pictures, taken_s), limits)
        if fault is not None:
            out.append((moved.misfit, (fault,)))
    return out


def _slipped(
    prior: CellPrior, pictures: Sequence[BoardPicture], fit: CellFit, limits: FaultLimits
) -> list[tuple[float, tuple[KinematicsFault, ...]]]:
    """Return the likelihood of the pictures if the plate slipped in the jaws, for each grasp."""
    out: list[tuple[float, tuple[KinematicsFault, ...]]] = []
    for grasp, held in prior.grasps.items():
        columns = fit.layout.where(f"{grasp}.grasp")
        own = [i for i, p in enumerate(pictures) if p.held_as == grasp]
        helped = _helped(fit, pictures, own, columns)
        if not helped.is_worth(fit):
            continue
        taken_s = helped.since_s
        after = f"{grasp} later"
        renamed = [
            replace(p, held_as=after) if p.held_as == grasp and p.taken_s >= taken_s else p
            for p in pictures
        ]
        grasps = {**prior.grasps, after: held}
        slipped = calibrate_cell(replace(prior, grasps=grasps), renamed)
        by = (
            slipped.x[slipped.layout.where(f"{after}.grasp")]
            - slipped.x[slipped.layout.where(f"{grasp}.grasp")]
        )
        fault = _moved("plate_slipped", grasp, by, _named(pictures, taken_s), limits)
        if fault is not None:
            out.append((slipped.misfit, (fault,)))
    return out


def _moved(
    kind: str, subject: str, by: FloatArray, since: str, limits: FaultLimits
) -> KinematicsFault | None:
    """Return the fault of an object that moved (6,) [rad, mm], if it is large enough."""
    turn, shift = float(np.linalg.norm(by[:3])), float(np.linalg.norm(by[3:]))
    if turn < limits.moved_rad and shift < limits.moved_mm:
        return None
    what = {
        "camera_moved": f"the camera {subject} was moved",
        "plate_slipped": f"the plate slipped in the jaws ({subject})",
    }[kind]
    return KinematicsFault(
        kind,
        subject,
        f"{what} by {shift:.1f} mm and {degrees(turn):.2f} deg before picture {since}; "
        "fasten it and take the pictures again",
    )


def _named(pictures: Sequence[BoardPicture], taken_s: float) -> str:
    return min((p for p in pictures if p.taken_s >= taken_s), key=lambda p: p.taken_s).name


@dataclass(frozen=True, slots=True)
class _Helped:
    """Return the gain from other values for the later pictures, and its best starting point."""

    gain: float
    since_s: float

    def is_worth(self, fit: CellFit) -> bool:
        """Return whether a fit is worth its time."""
        return np.isfinite(self.since_s) and (self.gain > _LIKELIER or _is_loose(fit))


def _is_loose(fit: CellFit) -> bool:
    """Return whether the joints seem to move as by a fault, which blunts every other test."""
    expected = fit.layout.prior.joint_std
    return bool((fit.joint_std > _LOOSE_JOINTS * expected).any())


def _helped(
    fit: CellFit, pictures: Sequence[BoardPicture], own: Sequence[int], columns: slice
) -> _Helped:
    """Return the time since when values of their own would help some pictures most.

    The gain of every time is worked out to first order from one factorisation of the fit.

    Parameters
    ----------
    fit, pictures : as calibrated
    own : indices of the pictures
    columns : the unknowns that would change
    """
    layout = fit.layout
    terms = layout.evaluate(fit.x, pictures)
    white = [
        whitening(t, u, fit.noise_px, fit.joint_std) for t, u in zip(terms, fit.used, strict=True)
    ]
    r, jac = stacked(layout, terms, white, fit.x / layout.std)
    basis, _ = np.linalg.qr(jac)
    ends = np.cumsum([0, *(len(w.weights) for w in white)])
    size = columns.stop - columns.start
    scale = _LOOSE_MOVE if size == len(_LOOSE_MOVE) else np.full(size, _LOOSE_SCALE)
    gradient, overlap, normal = np.zeros(size), np.zeros((size, basis.shape[1])), np.eye(size)
    best = _Helped(0.0, np.nan)
    least = _PICTURES_MIN if size == len(_LOOSE_MOVE) else 0
    order = sorted(own, key=lambda i: pictures[i].taken_s)
    for rank, i in enumerate(reversed(order)):
        rows = slice(ends[i], ends[i + 1])
        by = white[i].apply(_columns(terms[i], columns)) * scale
        gradient = gradient + by.T @ r[rows]
        overlap = overlap + by.T @ basis[rows]
        normal = normal + by.T @ by
        if rank + 1 < least or len(order) - rank - 1 < least:
            continue
        gain = float(gradient @ np.linalg.solve(normal - overlap @ overlap.T, gradient))
        if gain > best.gain:
            best = _Helped(gain, pictures[i].taken_s)
    return best


def _columns(terms: PictureTerms, columns: slice) -> FloatArray:
    """Return the derivatives (2 n, k) of one picture by some unknowns."""
    at = [int(np.flatnonzero(terms.columns == c)[0]) for c in range(columns.start, columns.stop)]
    out: FloatArray = terms.by_unknowns[:, :, at].reshape(-1, len(at))
    return out


def _odd_pictures(fit: CellFit, limits: FaultLimits) -> tuple[KinematicsFault, ...]:
    """Return pictures far off the cell, compared with their own kind.

    One picture that is far off makes the joints appear loose, and all others too good.
    """
    held = [one for one in fit.pictures if one.is_held]
    usual = float(np.median([one.off_sigma for one in held])) if held else 1.0
    return tuple(
        KinematicsFault(
            "picture",
            one.name,
            say(
                "{name} shows the board {times:.0f} times as far from where "
                "the cell has it as others do, {allowed:g} times are "
                "allowed; take it again",
                name=one.name,
                times=one.off_sigma / usual,
                allowed=limits.picture_ratio,
            ),
        )
        for one in held
        if one.off_sigma > limits.picture_ratio * usual
    )


def _out_of_bounds(fit: CellFit, limits: FaultLimits) -> tuple[KinematicsFault, ...]:
    layout: UnknownsLayout = fit.layout
    out = []
    for name, x, known, std in zip(layout.names, fit.x, fit.std, layout.std, strict=True):
        off = (abs(float(x)) - 2.0 * float(known)) / float(std)  # what is certain of it
        if off > limits.prior_sigma and ".placed." not in name:
            out.append(
                KinematicsFault(
                    "out_of_bounds",
                    name,
                    say(
                        "{name} is {x:+.4g} off its drawing, at least {off:.1f} standard "
                        "deviations of what a set-up leaves, {prior_sigma:g} are allowed; "
                        "check the drawing",
                        name=name,
                        x=float(x),
                        off=off,
                        prior_sigma=limits.prior_sigma,
                    ),
                )
            )
    return tuple(out)
