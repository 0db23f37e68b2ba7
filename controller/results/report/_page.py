"""Content of one part's page for the template: cut-outs, overlays, ledger, times."""

from collections.abc import Mapping
from dataclasses import dataclass

from ..run import Box, FindingReport, PartReport, Points, SightingReport, ViewReport
from ._optics import Optics
from ._words import verdict_word
from .ledger import Ledger, Timing, make_ledger, make_timing
from .pictures import Pictures, Shot, bounds, outline_path, window_round
from .signed.looks import picture_of

VIEW_MARGIN, VIEW_MIN_PX = 0.18, 260
TABLE_MARGIN, TABLE_MIN_PX = 0.35, 400
CROP_MARGIN, CROP_MIN_PX = 0.9, 110
SCALE_BAR_MM = 10.0
LAMP_WORDS = {"backlit": "backlight"}


@dataclass(frozen=True, slots=True)
class Mark:
    """A numbered box on a picture, x0, y0, x1, y1 [px]."""

    number: int
    box: Box


@dataclass(frozen=True, slots=True)
class MarkedPicture:
    """A picture with overlaid marks.

    Attributes
    ----------
    marks : boxes of findings
    bar_px : length of the scale bar; None if the scale is unknown
    arrow : x0, y0, x1, y1 of an arrow from a sighting's position in its direction
    border : SVG path round the difference, where it is known
    """

    lamp: str
    shot: Shot
    marks: tuple[Mark, ...] = ()
    bar_px: float | None = None
    arrow: tuple[float, ...] = ()
    border: str = ""


@dataclass(frozen=True, slots=True)
class ViewPanel:
    """A view: its pictures side by side, and the SVG path of the outline overlaid on each."""

    view: ViewReport
    key: str
    outline: str
    panels: tuple[MarkedPicture, ...]

    @property
    def first(self) -> int | None:
        """Index of the panel that defines the outline; the others refer to it."""
        return next((i for i, panel in enumerate(self.panels) if not panel.shot.why_missing), None)


@dataclass(frozen=True, slots=True)
class FindingRow:
    """A finding with the names of its faces and a cut-out of its place."""

    finding: FindingReport
    lamp: str
    faces: str
    panel: MarkedPicture | None


@dataclass(frozen=True, slots=True)
class PartPage:
    """Whole page of a part."""

    part: PartReport
    word: str
    why: str
    table: tuple[MarkedPicture, ...]
    findings: tuple[FindingRow, ...]
    views: tuple[ViewPanel, ...]
    ledger: Ledger | None
    timing: Timing
    bar_mm: float

    @property
    def evaluated(self) -> int:
        """Number of evaluated views."""
        return sum(view.evaluated is True for view in self.part.views)


def lamp_words(lamp: str) -> str:
    """Return the common name of a lamp, such as ring for ``station_ring``."""
    short = lamp.removeprefix("station_").removeprefix("table_")
    return LAMP_WORDS.get(short, short.replace("_", " "))


def css_class(verdict: str) -> str:
    """Return the CSS class of a verdict; the colour always comes with the word."""
    return {"pass": "pass", "fail": "fail", "indeterminate": "doubt"}.get(verdict, "none")


def make_part_page(
    part: PartReport, why: str, pictures: Pictures, optics: Optics | None
) -> PartPage:
    """Return the page of a part.

    Parameters
    ----------
    part : the part, from the journal
    why : reason for its verdict
    pictures : pictures of the run
    optics : calibrated cameras of the run; None leaves out the arrow and the scale bars
    """
    return PartPage(
        part=part,
        word=verdict_word(part),
        why=why,
        table=_table(part, pictures, optics),
        findings=tuple(
            _finding(part, view, finding, pictures, optics)
            for view in part.views
            for finding in view.findings
        ),
        views=tuple(
            _view(f"p{part.number}v{i}", view, pictures, optics)
            for i, view in enumerate(part.views)
        ),
        ledger=make_ledger(part),
        timing=make_timing(part.steps),
        bar_mm=SCALE_BAR_MM,
    )


def _table(
    part: PartReport, pictures: Pictures, optics: Optics | None
) -> tuple[MarkedPicture, ...]:
    marks = tuple(Mark(i, s.box_px) for i, s in enumerate(part.sightings, start=1))
    bar = SCALE_BAR_MM / optics.table_mm_per_px if optics else None
    arrow: tuple[float, ...] = ()
    taken = next((s for s in part.sightings if s.is_taken), None)
    if optics and taken is not None:
        arrow = _arrow(taken, optics)
    panels: list[MarkedPicture] = []
    for lamp, name in part.table_pictures.items():
        # The first picture shows the whole table, the others the objects on it.
        size = pictures.size_px(name)
        boxes = [s.box_px for s in part.sightings]
        window = window_round(boxes, size, TABLE_MARGIN, TABLE_MIN_PX) if size else None
        shot = pictures.view(name, window if panels else None)
        panels.append(MarkedPicture(lamp_words(lamp), shot, marks, bar, arrow))
    return tuple(panels)


def _arrow(sighting: SightingReport, optics: Optics) -> tuple[float, ...]:
    if sighting.part is None:
        return ()
    return optics.arrow_px(sighting.x_mm, sighting.y_mm, sighting.theta_deg)


def _view(key: str, view: ViewReport, pictures: Pictures, optics: Optics | None) -> ViewPanel:
    boxes = [f.box_px for f in view.findings if f.box_px]
    around = bounds(view.outline_px)
    if around is not None:
        boxes.append(around)
    is_on_table = any(lamp.startswith("table_") for lamp in view.pictures)
    bar = None
    if optics:
        bar = SCALE_BAR_MM / (optics.table_mm_per_px if is_on_table else optics.station_mm_per_px)
    panels = []
    for lamp, name in view.pictures.items():
        size = pictures.size_px(name)
        window = window_round(boxes, size, VIEW_MARGIN, VIEW_MIN_PX) if size else None
        marks = tuple(
            Mark(f.number, f.box_px)
            for f in view.findings
            if f.box_px and picture_of(view, f.lamp) == name
        )
        panels.append(MarkedPicture(lamp_words(lamp), pictures.view(name, window), marks, bar))
    return ViewPanel(view, key, outline_path(view.outline_px), tuple(panels))


def _finding(
    part: PartReport,
    view: ViewReport,
    finding: FindingReport,
    pictures: Pictures,
    optics: Optics | None,
) -> FindingRow:
    name = picture_of(view, finding.lamp)
    panel = None
    if name is not None and finding.box_px is not None:
        size = pictures.size_px(name)
        window = (
            window_round([finding.box_px], size, CROP_MARGIN, CROP_MIN_PX)
            if size
            else finding.box_px
        )
        shot = pictures.crop(name, window)
        bar = SCALE_BAR_MM / optics.station_mm_per_px if optics else None
        marks = (Mark(finding.number, finding.box_px),)
        panel = MarkedPicture(
            lamp_words(finding.lamp), shot, marks, bar, border=_closed(finding.outline_px)
        )
    labels = _labels(part)
    faces = ", ".join(labels.get(i, f"F{i}") for i in finding.faces)
    return FindingRow(finding, lamp_words(finding.lamp), faces, panel)


def _closed(points: Points) -> str:
    if not points:
        return ""
    return "M" + "L".join(f"{x + 0.5:g} {y + 0.5:g}" for x, y in points) + "Z"


def _labels(part: PartReport) -> Mapping[int, str]:
    return {f.face: f.label for f in part.verdict.faces} if part.verdict else {}
