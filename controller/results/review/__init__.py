"""A judged part for a person's decision: each finding as seen, as predicted, the difference.

`prediction.py` draws the expectation from CAD, `crops.py` cuts it out beside the picture,
`place.py` shows its place on the part, `page.py` puts all of it on a page. Nothing is judged here.
"""

from .crops import CROPS, Crop, FindingCrops, PartCrops, ShownCrop, border_in
from .page import jpeg, write_review_page

__all__ = [
    "CROPS",
    "Crop",
    "FindingCrops",
    "PartCrops",
    "ShownCrop",
    "border_in",
    "jpeg",
    "write_review_page",
]
