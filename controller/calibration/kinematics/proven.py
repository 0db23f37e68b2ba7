"""A calibration with its faults, and without the odd picture that one in some hundred is.

A motor that once comes to rest a few counts off puts the board of that picture far from its pose in
the cell. Such a picture has no information on the cell, and all others agree without it.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from ._types import BoardPicture, CellPrior
from .faults import KinematicsFault, find_faults
from .play import Play
from .solve import CellFit, calibrate_cell

MAX_ODD = 2  # more than these are not chance


@dataclass(frozen=True, slots=True, eq=False)
class ProvenFit:
    """A cell as its pictures show it, and the faults found in it.

    Attributes
    ----------
    fit : fit of all pictures but those left out
    play : play of each motor's gears
    faults : empty where all is well
    left_out : the faults of pictures that the fit does without
    """

    fit: CellFit
    play: Mapping[str, Play]
    faults: tuple[KinematicsFault, ...]
    left_out: tuple[KinematicsFault, ...]


def calibrate_and_prove(
    prior: CellPrior,
    pictures: Sequence[BoardPicture],
    play_of: Callable[[CellFit], Mapping[str, Play]] = lambda fit: {},
) -> ProvenFit:
    """Return a cell with its faults, without odd pictures where only `MAX_ODD` are wrong.

    Parameters
    ----------
    prior, pictures : as `calibrate_cell` takes them
    play_of : measures the play of gears, given a fit

    Raises
    ------
    KinematicsError : no cell fits the pictures
    """

    def proven(of: Sequence[BoardPicture], left_out: tuple[KinematicsFault, ...]) -> ProvenFit:
        fit = calibrate_cell(prior, of)
        play = play_of(fit)
        return ProvenFit(fit, play, find_faults(prior, of, fit, play=play), left_out)

    first = proven(pictures, ())
    odd = first.faults
    if not odd or len(odd) > MAX_ODD or any(fault.kind != "picture" for fault in odd):
        return first
    names = {fault.subject for fault in odd}
    second = proven([one for one in pictures if one.name not in names], odd)
    return first if second.faults else second
