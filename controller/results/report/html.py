"""HTML page of judged parts, made from the journal and the pictures alone.

On paper it consists of each part's sheets for signature; on the screen the rest opens on demand.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Final

from jinja2 import Template

from controller.cad import Solid

from ..judged import JudgedPart, judged_parts
from ..judged.cad import solid_in_run
from ..pages import css_text, make_environment
from ..run import RunRecord, row_words, stage_words
from ..takt import run_takt, takt_line
from ..wording import utc
from ._optics import Optics
from ._page import PartPage, css_class, lamp_words, make_part_page
from ._words import cautions, defect_words, end_words, headline, why, why_in_run
from .pictures import QUALITIES, Pictures, Quality
from .signed import PartSheets, look_count, make_sheets

# Largest size of any page, to pass mail gateways, and of one part's, to open fast on a slow line.
MAX_BYTES = 10_000_000
PART_BYTES: Final = 2_000_000
# Number of parts above which looks at passed characteristics are left out, to keep the page short.
MANY_PARTS: Final = 10
LOG_ROWS = 3000
NO_CAD: Final = "no CAD model was given to this report"
TEMPLATES = ("report.html.j2", "part.html.j2", "signed.html.j2", "report.css")
FILTERS: Final[Mapping[str, Callable[..., str]]] = {
    "utc": utc,
    "row_words": row_words,
    "stage": stage_words,
    "css": css_class,
    "lamp_words": lamp_words,
    "defect_words": defect_words,
    "css_text": css_text,
}


def render(
    record: RunRecord,
    max_bytes: int = MAX_BYTES,
    *,
    on_paper: bool = False,
    qif_sha256: str = "",
) -> str:
    """Return the page of a run, with pictures reduced until the page is small enough.

    Parameters
    ----------
    record : the run
    max_bytes : largest size of the page
    on_paper : True to leave out content that opens on demand
    qif_sha256 : hash of the same results as QIF, which the page then names
    """
    return _render(
        judged_parts(record),
        solids_of(record),
        record,
        max_bytes,
        on_paper=on_paper,
        qif_sha256=qif_sha256,
    )


def solids_of(record: RunRecord) -> Callable[[JudgedPart], Solid | str]:
    """Return a cached lookup of the CAD model of a run's part, or of why there is none."""
    known: dict[str, Solid | str] = {}

    def solid(judged: JudgedPart) -> Solid | str:
        file = record.recipe_of(judged.part).file
        if file not in known:
            known[file] = solid_in_run(record, judged.part)
        return known[file]

    return solid


def render_parts(
    parts: Sequence[JudgedPart], solid: Solid | None = None, *, on_paper: bool = False
) -> str:
    """Return the page of judged parts without a run.

    Parameters
    ----------
    parts : judged parts of one product
    solid : its CAD model, for the drawings; None if unavailable
    on_paper : True to leave out content that opens on demand
    """
    return _render(parts, lambda _: solid or NO_CAD, None, MAX_BYTES, on_paper=on_paper)


@cache
def _template() -> Template:
    """Return the template of the page, compiled once."""
    return make_environment(__package__, TEMPLATES, FILTERS).get_template("report.html.j2")


def _render(
    parts: Sequence[JudgedPart],
    solid: Callable[[JudgedPart], Solid | str],
    record: RunRecord | None,
    max_bytes: int,
    *,
    on_paper: bool,
    qif_sha256: str = "",
) -> str:
    count = sum(
        len(judged.part.table_pictures)
        + len(judged.part.findings)
        + sum(len(view.pictures) for view in judged.part.views)
        + sum(min(len(c.looks), look_count(c)) for c in judged.part.characteristics)
        for judged in parts
    )
    max_bytes = min(max_bytes, PART_BYTES * max(1, len(parts)))
    fitting = [q for q in QUALITIES if count * q.typical_bytes <= max_bytes]
    text = ""
    for quality in fitting:
        text = _page(parts, solid, record, quality, on_paper=on_paper, qif_sha256=qif_sha256)
        if len(text.encode()) <= max_bytes:
            return text
    return text


def _page(
    parts: Sequence[JudgedPart],
    solid: Callable[[JudgedPart], Solid | str],
    record: RunRecord | None,
    quality: Quality,
    *,
    on_paper: bool,
    qif_sha256: str = "",
) -> str:
    pages: list[tuple[JudgedPart, PartPage, PartSheets]] = []
    is_long = len(parts) > MANY_PARTS
    for judged in parts:
        is_brief = on_paper or (is_long and _has_passed(judged))
        pictures = Pictures(judged.pictures, quality)
        optics = Optics.of(judged.header.cell_settings)
        reason = why_in_run(record, judged.part) if record else why(judged.part)
        pages.append(
            (
                judged,
                make_part_page(judged.part, reason, pictures, optics),
                make_sheets(judged, solid(judged), pictures, lamp_words, all_looks=not is_brief),
            )
        )
    if record is not None:
        word, sentence = headline(record)
    else:
        word, sentence = (pages[0][1].word, pages[0][1].why) if pages else ("no verdict", "")
    left_out = max(0, len(record.log) - LOG_ROWS) if record else 0
    return _template().render(
        record=record,
        document=_document(parts[0] if parts else None, record),
        product=record.recipe_name if record else parts[0].header.part,
        software=record.software if record else parts[0].header.software,
        emulated=record.emulated_devices if record else parts[0].header.emulated_devices,
        word=word,
        why=sentence,
        end_words=end_words(record) if record else "",
        takt=takt_line(run_takt(record)) if record else "",
        cautions=cautions(record) if record else [],
        parts=pages,
        log=record.log[left_out:] if record else (),
        log_left_out=left_out,
        is_reduced=quality is not QUALITIES[0],
        is_long=is_long,
        qif_sha256=qif_sha256,
        on_paper=on_paper,
    )


def _document(first: JudgedPart | None, record: RunRecord | None) -> str:
    """Return the heading of each printed page: product and run, or the date of the verdict."""
    if record is not None:
        return f"Inspection report {record.recipe_name}, run {record.run_id}"
    assert first is not None  # a report without a run has at least one part
    named = " ".join((first.header.part, first.header.serial)).strip()
    return f"Inspection report {named}, {utc(first.header.start)}"


def _has_passed(judged: JudgedPart) -> bool:
    verdict = judged.part.verdict
    return verdict is not None and verdict.verdict == "pass"
