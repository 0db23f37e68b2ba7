"""Pages as PDF, from the HTML that is printed: no other program is needed.

The engine comes with its wheel (ADR 31). It is given the page and nothing else: no file, no
network. The same page gives the same bytes.
"""

import io
from datetime import datetime
from typing import Final

from .run import ResultsError

# a document that embeds no font has no letters in it
FONT_MARK: Final = b"/FontDescriptor"
# links within the page need the page to have an address; nothing is ever read from it
OWN_ADDRESS: Final = "page:///"


class PdfError(ResultsError):
    """No PDF can be made on this machine; the message names the missing program."""


MM_PER_POINT: Final = 25.4 / 72


def pdf_bytes(
    page: str, title: str, at: datetime, paper_mm: tuple[float, float] | None = None
) -> bytes:
    """Return a page as a PDF document.

    Parameters
    ----------
    page : HTML that needs nothing but itself
    title : title of the document
    at : end of the work reported on; the document's date
    paper_mm : width and height of the paper, without a margin; None for A4 with the usual margins

    Raises
    ------
    PdfError : the engine or every font is missing
    """
    try:
        import plutoprint
    except ImportError as error:
        raise PdfError(
            f"no PDF can be made: {error}; install the package plutoprint, or print the HTML page"
        ) from error

    class OwnData(plutoprint.ResourceFetcher):
        """Pictures inside the page, nothing from outside."""

        def fetch_url(self, url: str) -> plutoprint.ResourceData:
            if not url.startswith("data:"):
                raise PermissionError(f"a page refers to {url[:80]}")
            return plutoprint.default_resource_fetcher.fetch_url(url)

    size, margins = plutoprint.PAGE_SIZE_A4, plutoprint.PAGE_MARGINS_NORMAL
    if paper_mm is not None:
        size = plutoprint.PageSize(*(side / MM_PER_POINT for side in paper_mm))
        margins = plutoprint.PAGE_MARGINS_NONE
    book = plutoprint.Book(size, margins, plutoprint.MEDIA_TYPE_PRINT)
    book.custom_resource_fetcher = OwnData()
    book.load_html(page, base_url=OWN_ADDRESS)
    date = at.isoformat(timespec="seconds")
    book.set_metadata(plutoprint.PDF_METADATA_TITLE, title)
    book.set_metadata(plutoprint.PDF_METADATA_CREATOR, "cellctl")
    book.set_metadata(plutoprint.PDF_METADATA_CREATION_DATE, date)
    book.set_metadata(plutoprint.PDF_METADATA_MODIFICATION_DATE, date)
    out = io.BytesIO()
    book.write_to_pdf_stream(out)
    found = out.getvalue()
    if FONT_MARK not in found:
        raise PdfError(
            "no PDF can be made: this machine has no font, and the page would be without letters; "
            "install one (Debian: fonts-dejavu-core), or print the HTML page"
        )
    return found
