"""One page for a commissioned cell, from the records and pictures that its steps left."""

import base64
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2

from controller.config.calibrations import read_calibrations
from controller.results.pages import render_page
from controller.results.wording import utc
from drivers.pictures import BrokenPictureError, decode
from messages import say

from ..procedure import (
    CommissioningFolder,
    StepFigure,
    StepPicture,
    StepRecord,
    StepStanding,
    StepStatus,
)

TEMPLATE: Final = "commissioned.html.j2"
WIDTH_PX: Final = 420  # width of a picture on the page; the evidence has the full size
JPEG_QUALITY: Final = 80
BADGE: Final = {
    StepStatus.DONE: "pass",
    StepStatus.STALE: "doubt",
    StepStatus.FAILED: "fail",
    StepStatus.NOT_DONE: "none",
}


@dataclass(frozen=True, slots=True)
class PagePicture:
    """A picture on the page; `data` is empty if its file is gone or was changed."""

    caption: str
    file: str
    data: str


@dataclass(frozen=True, slots=True)
class StepShown:
    """A step on the page."""

    standing: StepStanding
    badge: str
    record: StepRecord | None
    figures: tuple[tuple[StepFigure, str], ...]
    pictures: tuple[PagePicture, ...]
    times: str


def write_evidence_page(
    folder: CommissioningFolder, standings: Sequence[StepStanding], name: str
) -> Path:
    """Write the page of a commissioning into its folder and return its path.

    Parameters
    ----------
    folder : folder of the commissioning
    standings : standing of each step, in order
    name : name of the cell

    Raises
    ------
    ConfigError : a record or a calibration is damaged
    OSError : the page cannot be written
    """
    records = folder.read_records(tuple(one.step for one in standings))
    calibrations = read_calibrations(folder.cell_file, folder.references())
    shown = [_step(folder, one, records.get(one.step)) for one in standings]
    return render_page(
        __package__,
        TEMPLATE,
        folder.path / "commissioning.html",
        name=name,
        steps=shown,
        open_steps=[one for one in standings if one.status is not StepStatus.DONE],
        emulated=sorted({device for one in records.values() for device in one.emulated}),
        calibrations=[
            (key, one, folder.references()[key].sha256) for key, one in calibrations.items()
        ],
        utc=utc,
    )


def _step(
    folder: CommissioningFolder, standing: StepStanding, record: StepRecord | None
) -> StepShown:
    badge = BADGE[standing.status]
    if record is None:
        return StepShown(standing, badge, None, (), (), "")
    place = folder.path / record.evidence
    return StepShown(
        standing,
        badge,
        record,
        tuple((figure, allowed(figure)) for figure in record.figures),
        tuple(_shown(place, picture) for picture in record.pictures),
        say("{began} to {ended}", began=utc(record.began), ended=utc(record.ended)),
    )


def allowed(figure: StepFigure) -> str:
    """Return a figure's limits in words; empty if it has none."""
    if figure.low is not None and figure.high is not None:
        return say("{low:g} to {high:g}", low=figure.low, high=figure.high)
    if figure.low is not None:
        return f"at least {figure.low:g}"
    return f"at most {figure.high:g}" if figure.high is not None else ""


def _shown(place: Path, picture: StepPicture) -> PagePicture:
    path = place / picture.file
    try:
        data = path.read_bytes()
    except OSError:
        return PagePicture(picture.caption, picture.file, "")
    if hashlib.sha256(data).hexdigest() != picture.sha256:
        return PagePicture(picture.caption, picture.file, "")
    try:
        image = decode(data, "grey")
    except BrokenPictureError:
        return PagePicture(picture.caption, picture.file, "")
    height, width = image.shape
    small = cv2.resize(
        image, (WIDTH_PX, round(height * WIDTH_PX / width)), interpolation=cv2.INTER_AREA
    )
    jpeg = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1]
    return PagePicture(picture.caption, picture.file, base64.b64encode(jpeg.tobytes()).decode())
