"""A run as one HTML page: all it says comes from the journal and the run's pictures."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

from ..pages import make_environment, write_page
from ..run import RunRecord, row_words, stage_words
from ..wording import utc
from ._optics import Optics
from ._page import css_class, lamp_words, make_part_page
from ._words import END_WORDS, cautions, headline
from .pictures import QUALITIES, Pictures, Quality

# A page must pass mail gateways; pictures may take this much of it.
MAX_BYTES = 10_000_000
PICTURE_BYTES = 8_000_000
LOG_ROWS = 3000
TEMPLATES = ("report.html.j2", "part.html.j2")
FILTERS: Final[Mapping[str, Callable[..., str]]] = {
    "utc": utc,
    "row_words": row_words,
    "stage": stage_words,
    "css": css_class,
    "lamp_words": lamp_words,
}


def write_html(record: RunRecord, path: Path) -> Path:
    """Write the report of a run and return its path.

    The file is whole or not there.

    Raises
    ------
    OSError : the file cannot be written
    """
    return write_page(render(record), path)


def render(record: RunRecord, max_bytes: int = MAX_BYTES) -> str:
    """Return the page; pictures are made smaller until it is small enough."""
    count = sum(
        len(part.table_pictures)
        + len(part.findings)
        + sum(len(view.pictures) for view in part.views)
        for part in record.parts
    )
    budget = min(PICTURE_BYTES, max_bytes)
    fitting = [q for q in QUALITIES if count * q.typical_bytes <= budget]
    text = ""
    for quality in fitting:
        text = _render(record, quality)
        if len(text.encode()) <= max_bytes:
            return text
    return text


def _render(record: RunRecord, quality: Quality) -> str:
    pictures, optics = Pictures(record.folder, quality), Optics.of(record.cell)
    word, sentence = headline(record)
    left_out = max(0, len(record.log) - LOG_ROWS)
    return (
        make_environment(__package__, TEMPLATES, FILTERS)
        .get_template("report.html.j2")
        .render(
            record=record,
            word=word,
            why=sentence,
            end_words=END_WORDS[record.outcome.end],
            cautions=cautions(record),
            parts=[make_part_page(record, part, pictures, optics) for part in record.parts],
            log=record.log[left_out:],
            log_left_out=left_out,
            is_reduced=quality is not QUALITIES[0],
        )
    )
