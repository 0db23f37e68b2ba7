"""The pages for a person to sign: three printed pages of a part, ready for the template.

`balloons.py` is the drawing with balloons, `table.py` the rows of characteristics with their
deviation bars, `looks.py` cut-outs with rays and fitted shapes, `covering.py` the part coloured by
the ledger, `sheets.py` puts them together.
"""

from .sheets import MAX_LOOKS, PartSheets, look_count, make_sheets

__all__ = ["MAX_LOOKS", "PartSheets", "look_count", "make_sheets"]
