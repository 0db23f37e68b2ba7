"""Content of a part's three printed pages for the template."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from controller.cad import Solid
from controller.cell.journal.rows import CharacteristicFields, LookFields, PartJudged

from ...judged import DECISION_RULE, JudgedPart
from ...run import ViewReport
from ...wording import utc
from .._words import review_words
from ..pictures import Pictures, Shot, bounds, window_round
from .balloons import BalloonDrawing, balloon_drawing
from .covering import CoverageSide, coverage_sides
from .looks import LookPanel, look_panel
from .table import Brief, TableRow, briefly, rows_of, tally

HASH_LENGTH: Final = 12
PAPER_WORDS: Final[Mapping[str, str]] = {
    "part_number": "Part number",
    "drawing_number": "Drawing",
    "revision": "Revision",
    "order_number": "Order",
    "gauge_id": "Gauge",
}
NOT_GIVEN: Final = "not given"
# Largest number of looks at one characteristic on the screen.
MAX_LOOKS: Final = 3
# Largest number of pictures of characteristics and of views on paper: two rows.
MAX_TILES: Final = 14
MARGIN, MIN_PX = 0.12, 200


@dataclass(frozen=True, slots=True)
class Thumbnail:
    """Thumbnail of a view."""

    view: str
    lamp: str
    shot: Shot
    is_evaluated: bool


@dataclass(frozen=True, slots=True)
class PartSheets:
    """Content of the three pages.

    Attributes
    ----------
    facts : names and values of the header
    drawing, sides : None and empty if the CAD file is unavailable; `no_drawing` gives the reason
    looks : looks that can be drawn, by balloon, where all are requested; `crops` has the best of
        each
    left_out : characteristics and views that do not fit on the contact sheet
    """

    facts: tuple[tuple[str, str], ...]
    rule: str
    tally: tuple[tuple[str, int], ...]
    rows: tuple[TableRow, ...]
    brief: Brief
    drawing: BalloonDrawing | None
    no_drawing: str
    sides: tuple[CoverageSide, ...]
    looks: tuple[LookPanel, ...]
    crops: tuple[LookPanel, ...]
    thumbnails: tuple[Thumbnail, ...]
    left_out: tuple[int, int]


def make_sheets(
    judged: JudgedPart,
    solid: Solid | str,
    pictures: Pictures,
    lamp_words: Callable[[str], str],
    *,
    all_looks: bool = True,
) -> PartSheets:
    """Return the printable sheets of a part.

    Parameters
    ----------
    judged : the judged part
    solid : its CAD model, or the reason why there is none
    pictures : pictures of the part
    lamp_words : function that returns the common name of a lamp
    all_looks : True for more looks than the best of each characteristic
    """
    part = judged.part
    rows = rows_of(part.characteristics)
    views = {view.view: view for view in part.views}
    panels = [
        panel
        for row in rows
        for look in looks_to_draw(row.c, look_count(row.c) if all_looks else 1)
        if (panel := look_panel(row.c, look, views, pictures, lamp_words(look.lamp)))
    ]
    best: dict[int, LookPanel] = {}
    for panel in sorted(panels, key=lambda p: bool(p.look.reason)):
        best.setdefault(panel.c.balloon, panel)
    # Characteristics that did not pass come first, since the page may not have room for all.
    crops = sorted(best.values(), key=lambda p: (p.c.verdict == "pass", p.c.balloon))
    view_count = max(0, MAX_TILES - len(crops))
    thumbnails = [t for view in part.views if (t := _thumbnail(view, pictures, lamp_words))]
    drawing: BalloonDrawing | None = None
    sides: tuple[CoverageSide, ...] = ()
    if isinstance(solid, Solid):
        drawing = balloon_drawing(solid, part.characteristics)
        quality = pictures.quality
        if part.verdict and quality.map_px:
            sides = coverage_sides(solid, part.verdict.faces, quality.map_px, quality.jpeg)
    return PartSheets(
        facts=_facts(judged),
        rule=DECISION_RULE,
        tally=tally(part.characteristics),
        rows=rows,
        brief=briefly(rows),
        drawing=drawing,
        no_drawing=solid if isinstance(solid, str) else "",
        sides=sides,
        looks=tuple(panels) if all_looks else (),
        crops=tuple(crops[:MAX_TILES]),
        thumbnails=tuple(thumbnails[:view_count]),
        left_out=(max(0, len(crops) - MAX_TILES), max(0, len(thumbnails) - view_count)),
    )


def look_count(c: CharacteristicFields) -> int:
    """Return the number of looks at a characteristic on the screen; one if it passed."""
    return 1 if c.verdict == "pass" else MAX_LOOKS


def looks_to_draw(c: CharacteristicFields, count: int) -> tuple[LookFields, ...]:
    """Return the looks at a characteristic to draw; those that count come first.

    Parameters
    ----------
    c : the characteristic
    count : largest number of looks
    """
    drawn = [look for look in c.looks if look.points_px or look.shape_px]
    return tuple(sorted(drawn, key=lambda look: bool(look.reason))[:count])


def _thumbnail(
    view: ViewReport, pictures: Pictures, lamp_words: Callable[[str], str]
) -> Thumbnail | None:
    """Return the thumbnail of a view under its first lamp other than the backlight, if any."""
    if not view.pictures:
        return None
    lit = [lamp for lamp in view.pictures if not lamp.endswith("backlight")]
    lamp = lit[0] if lit else next(iter(view.pictures))
    name = view.pictures[lamp]
    size, around = pictures.size_px(name), bounds(view.outline_px)
    window = window_round([around], size, MARGIN, MIN_PX) if size and around else None
    shot = pictures.crop(name, window or (0, 0, *(size or (5, 4))))
    return Thumbnail(view.view, lamp_words(lamp), shot, bool(view.evaluated))


def _facts(judged: JudgedPart) -> tuple[tuple[str, str], ...]:
    h, verdict = judged.header, judged.part.verdict
    temperature = h.part_temperature_c
    read = judged.part.serial_picture
    facts = [
        *((words, h.papers[key]) for key, words in PAPER_WORDS.items() if h.papers.get(key)),
        ("Serial number", f"{h.serial}, read in {read}" if read else h.serial or NOT_GIVEN),
        ("Lot", h.lot or NOT_GIVEN),
        ("Operator", h.operator or NOT_GIVEN),
        ("Part (CAD)", _hashed(h.cad, h.cad_sha256)),
        ("Recipe", _hashed(h.recipe, h.recipe_sha256)),
        ("Cell", _hashed(h.cell, h.cell_sha256)),
        ("Calibrated", _calibrated(judged)),
        ("Part temperature", "not measured" if temperature is None else f"{temperature:.1f} °C"),
        ("Software", f"cellctl {h.software.get('cellctl', 'of unknown version')}"),
        ("Inspected", f"{utc(h.start)} to {h.end:%H:%M:%S}"),
        ("Tray", judged.part.tray or "none"),
        ("Surface compared", compared_words(verdict) if verdict else "–"),
    ]
    review = review_words(judged.part)
    return (*facts, ("Reviewed", review)) if review else tuple(facts)


def _hashed(name: str, sha256: str) -> str:
    if not name:
        return NOT_GIVEN
    return f"{name} ({sha256[:HASH_LENGTH]})" if sha256 else name


def _calibrated(judged: JudgedPart) -> str:
    dates = judged.header.calibrated
    known = ", ".join(f"{camera} {date}" for camera, date in dates.items() if date)
    dated = known or "no date in the cell file"
    # Calibrations that do not count are listed above the parts of a run.
    doubts = () if judged.header.run_id else judged.header.calibration or ()
    return "; ".join((dated, *doubts))


def compared_words(verdict: PartJudged) -> str:
    """Return the compared share of the surface with its uncertainty, in words."""
    share = f"{100 * verdict.compared_fraction:.2f} %"
    if verdict.compared_U is None:
        return share
    return f"{share} (U = {100 * verdict.compared_U:.2f} %, k = 2)"
