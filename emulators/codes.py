"""The codes that a workshop has marked its parts with: one number after another."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .world import LayoutError

KINDS: Final = ("data_matrix", "qr")


@dataclass(slots=True)
class PartCodes:
    """Codes with one number after another.

    Attributes
    ----------
    kind : symbology, one of `KINDS`
    text : text of the next code; its final digits count up
    """

    kind: str
    text: str

    def next(self) -> NDArray[np.bool_]:
        """Return the dark modules (n, n) of the next code.

        Raises
        ------
        LayoutError : the library that draws codes is missing, or cannot draw this text
        """
        text = self.text
        head = text.rstrip("0123456789")
        if digits := text[len(head) :]:
            self.text = f"{head}{int(digits) + 1:0{len(digits)}d}"
        try:
            import zxingcpp
        except ImportError as error:
            raise LayoutError(
                "--code: zxing-cpp is not installed: pip install 'cellctl[codes]'"
            ) from error
        is_qr = self.kind == "qr"
        formats = zxingcpp.BarcodeFormat
        # as GS1 writes it below its codes: identifiers in brackets
        options = {"gs1": True} if text.startswith("(") else {}
        try:
            drawn = zxingcpp.create_barcode(
                text, formats.QRCode if is_qr else formats.DataMatrix, **options
            )
        except ValueError as error:
            raise LayoutError(f"--code {text:.80}: {error}") from error
        image = np.array(drawn.to_image(scale=1, add_quiet_zones=False))
        return np.asarray(image < 128)


def codes_of(text: str) -> PartCodes | None:
    """Return the codes for ``KIND:TEXT``; None for an empty text.

    Raises
    ------
    LayoutError : it is of another form
    """
    if not text:
        return None
    kind, _, first = text.partition(":")
    if kind not in KINDS or not first or len(first) > 200:
        raise LayoutError(f"--code {text:.80}: KIND:TEXT, with {' or '.join(KINDS)} for the kind")
    return PartCodes(kind, first)
