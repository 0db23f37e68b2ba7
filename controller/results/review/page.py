"""A part's findings on one HTML page, for the person who decides; pictures inside, no script."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2

from ..pages import render_page
from ..report.pictures import data_uri
from .crops import CROPS, Crop, FindingCrops, PartCrops, border_in

JPEG_QUALITY: Final = 84
TITLES: Final[Mapping[Crop, str]] = {
    "picture": "picture",
    "predicted": "predicted by the CAD",
    "difference": "difference",
    "place": "where on the part",
}


@dataclass(frozen=True, slots=True)
class CropPanel:
    """A crop on the page: its data, or why there is none, and the finding's border over it."""

    title: str
    uri: str
    why_missing: str
    border: str


@dataclass(frozen=True, slots=True)
class ShownFinding:
    """A finding on the page."""

    crops: FindingCrops
    faces: str
    panels: tuple[CropPanel, ...]


def write_review_page(crops: PartCrops, part: Mapping[str, Any], path: Path) -> Path:
    """Write the page of a part and return its path.

    Parameters
    ----------
    crops : crops of the part's findings
    part : its record, as the history has it
    path : path of the page

    Raises
    ------
    OSError : the page cannot be written
    """
    found = []
    for finding in part["findings"]:
        one = crops.of(int(finding["number"]))
        if one is not None:
            faces = " and ".join(finding["faces"]) or "no face"
            found.append(
                ShownFinding(one, faces, tuple(_panel(crops, one, which) for which in CROPS))
            )
    return render_page(__package__, "review.html.j2", path, part=part, findings=found)


def _panel(crops: PartCrops, found: FindingCrops, which: Crop) -> CropPanel:
    seen = crops.crop(found, which)
    if seen.image is None:
        return CropPanel(TITLES[which], "", seen.why_missing, "")
    border = ""
    if which != "place":
        border = " ".join(f"{100 * x:.2f},{100 * y:.2f}" for x, y in border_in(found))
    return CropPanel(TITLES[which], data_uri(seen.image, JPEG_QUALITY), "", border)


def jpeg(image: Any) -> bytes:  # noqa: ANN401 - grey or blue first
    """Return a crop as JPEG."""
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return data.tobytes()
