"""Crops of a finding: the picture, the CAD's prediction, and the difference."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from controller.arrays import FloatArray
from controller.cad import Solid
from controller.imaging import RayCaster

from ..judged import JudgedPart, judged_parts
from ..judged.cad import solid_in_run
from ..report.pictures import grey_picture, window_round
from ..report.signed.looks import picture_of
from ..run import Box, FindingReport, RunRecord, ViewReport
from .place import MARK_BGR, place_drawing
from .prediction import PredictedPiece, Predictor

Crop = Literal["picture", "predicted", "difference", "place"]
CROPS: Final[tuple[Crop, ...]] = ("picture", "predicted", "difference", "place")
MARGIN, MIN_PX = 0.9, 160
SHOWN_PX: Final = 480  # width of a crop as shown
PLACE_PX: Final = 480
BRIGHT_LEVEL: Final = 215.0  # level to which dark pictures and their predictions are brightened
MAX_GAIN: Final = 4.0
MIN_RANGE: Final = 32.0  # grey levels that a difference spans at least: less is noise
HATCH_PX: Final = 7
MIN_SHARE: Final = 0.16  # share of the crop's width; a smaller border is drawn as a box round it
CORNERS: Final = ((-1, -1), (1, -1), (1, 1), (-1, 1))


@dataclass(frozen=True, eq=False, slots=True)
class ShownCrop:
    """A crop that can be shown.

    Attributes
    ----------
    image : (height, width) grey or (height, width, 3) blue first; None if there is none
    why_missing : reason why there is none
    """

    image: NDArray[np.uint8] | None
    why_missing: str = ""


@dataclass(frozen=True, slots=True)
class FindingCrops:
    """The source of a finding's crops.

    Attributes
    ----------
    file : file of the picture, relative to the run's folder; empty if there is none
    lamp : as in the cell file; empty if no picture is named
    window : x0, y0, x1, y1 of the crops in it [px]; None without a picture
    """

    finding: FindingReport
    view: ViewReport
    file: str
    lamp: str
    window: Box | None


class PartCrops:
    """The crops of one part's findings, each made on request.

    Parameters
    ----------
    record : the run, with the part
    judged : the part
    """

    def __init__(self, record: RunRecord, judged: JudgedPart) -> None:
        self.judged = judged
        self._record = record

    @classmethod
    def of_part(cls, record: RunRecord, number: int) -> "PartCrops | None":
        """Return the crops of a part by its number in the run; None if there is no such part."""
        every = judged_parts(record)
        return next((cls(record, one) for one in every if one.part.number == number), None)

    @cached_property
    def _solid(self) -> Solid | str:
        return solid_in_run(self._record, self.judged.part)

    @cached_property
    def _predictor(self) -> Predictor | str:
        return Predictor.of(self._solid, self._record.cell)

    def of(self, number: int) -> FindingCrops | None:
        """Return the source of a finding's crops; None if there is no such finding."""
        for view in self.judged.part.views:
            for finding in view.findings:
                if finding.number == number:
                    return self._found(view, finding)
        return None

    def _found(self, view: ViewReport, finding: FindingReport) -> FindingCrops:
        file = picture_of(view, finding.lamp) or ""
        lamp = next((name for name, one in view.pictures.items() if one == file), "")
        picture = grey_picture(self.judged.pictures, file) if file and finding.box_px else ""
        window = None
        if not isinstance(picture, str) and finding.box_px is not None:
            size = (picture.shape[1], picture.shape[0])
            window = window_round([finding.box_px], size, MARGIN, MIN_PX)
        return FindingCrops(finding, view, file, lamp, window)

    def crop(self, found: FindingCrops, which: Crop) -> ShownCrop:
        """Return a crop of a finding.

        Parameters
        ----------
        found : by `of`
        which : one of `CROPS`
        """
        if which == "place":
            return self._place(found.finding)
        nothing = "no picture was named"
        picture = grey_picture(self.judged.pictures, found.file) if found.file else nothing
        if isinstance(picture, str):
            return ShownCrop(None, picture)
        if found.window is None:
            return ShownCrop(None, f"picture {found.file} is missing")
        x0, y0, x1, y1 = found.window
        observed = np.asarray(picture[y0:y1, x0:x1], dtype=float)
        gain = _gain(observed)
        if which == "picture":
            return ShownCrop(_shown(gain * observed))
        if isinstance(self._predictor, str):
            return ShownCrop(None, self._predictor)
        predicted = self._predictor.predict(found.view, found.lamp, picture, found.window)
        if isinstance(predicted, str):
            return ShownCrop(None, predicted)
        if which == "predicted":
            return ShownCrop(_hatched(_shown(gain * predicted.level), predicted))
        return ShownCrop(_hatched(_difference(observed, predicted), predicted))

    def marked(self, found: FindingCrops, which: Crop) -> ShownCrop:
        """Return the same with the finding's border drawn into it."""
        seen = self.crop(found, which)
        points = border_in(found)
        if seen.image is None or which == "place" or not points:
            return seen
        image = cv2.cvtColor(seen.image, cv2.COLOR_GRAY2BGR)
        size = (image.shape[1], image.shape[0])
        at = np.round(np.asarray(points) * size).astype(np.int32)
        cv2.polylines(image, [at], True, (255, 255, 255), 5, cv2.LINE_AA)
        cv2.polylines(image, [at], True, MARK_BGR, 2, cv2.LINE_AA)
        return ShownCrop(np.asarray(image, dtype=np.uint8))

    def _place(self, finding: FindingReport) -> ShownCrop:
        if isinstance(self._solid, str):
            return ShownCrop(None, self._solid)
        if len(finding.p_part_mm) != 3:
            return ShownCrop(None, "the place on the part is not known")
        caster = RayCaster(self._solid.mesh)
        place = np.asarray(finding.p_part_mm, dtype=float)
        return ShownCrop(place_drawing(self._solid, caster, place, PLACE_PX))


def border_in(found: FindingCrops) -> tuple[tuple[float, float], ...]:
    """Return the finding's border as shares of its crop, 0..1.

    Its box stands where no border is known, and a larger one where the line would hide it.
    """
    if found.window is None or found.finding.box_px is None:
        return ()
    x0, y0, x1, y1 = found.window
    left, top, right, bottom = found.finding.box_px
    points = [(x + 0.5, y + 0.5) for x, y in found.finding.outline_px]
    least = MIN_SHARE * (x1 - x0)
    if not points or max(right - left, bottom - top) < least:
        half_x, half_y = max(right - left, least) / 2, max(bottom - top, least) / 2
        x, y = (left + right) / 2, (top + bottom) / 2
        points = [(x + sx * half_x, y + sy * half_y) for sx, sy in CORNERS]
    return tuple(((x - x0) / (x1 - x0), (y - y0) / (y1 - y0)) for x, y in points)


def _gain(observed: FloatArray) -> float:
    bright = float(np.percentile(observed, 99.5))
    return float(np.clip(BRIGHT_LEVEL / max(bright, 1.0), 1.0, MAX_GAIN))


def _shown(level: FloatArray) -> NDArray[np.uint8]:
    height, width = level.shape
    size = (SHOWN_PX, round(height * SHOWN_PX / width))
    grown = cv2.resize(np.clip(level, 0, 255), size, interpolation=cv2.INTER_CUBIC)
    return np.clip(grown, 0, 255).astype(np.uint8)


def _difference(observed: FloatArray, predicted: PredictedPiece) -> NDArray[np.uint8]:
    """Return picture less prediction: middle grey where they agree."""
    rest = np.where(predicted.known, observed - predicted.level, 0.0)
    scale = 127.0 / max(MIN_RANGE, float(np.percentile(np.abs(rest), 99.5)))
    return _shown(128.0 + scale * rest)


def _hatched(image: NDArray[np.uint8], predicted: PredictedPiece) -> NDArray[np.uint8]:
    """Hatch the pixels without a prediction."""
    size = (image.shape[1], image.shape[0])
    known = cv2.resize(predicted.known.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
    rows, columns = np.indices(image.shape)
    stripe = (rows + columns) % HATCH_PX == 0
    return np.where(known, image, np.where(stripe, 110, 190)).astype(np.uint8)
