"""The bytes of one picture into pixels, or the reason why not: damage is refused, never filled in.

Decoders repair: a JPEG that lost data in its middle comes out half grey, and a PGM cut off ends
in black. Whoever measures in pictures must not be handed those. Every picture that this program
reads, a camera's compressed frame or a file, comes through `decode`. Knows no camera and no file.
"""

from ._decode import MAX_PIXELS, Pixels, decode
from ._header import size_in_header
from ._whole import BrokenPictureError

__all__ = ["MAX_PIXELS", "BrokenPictureError", "Pixels", "decode", "size_in_header"]
