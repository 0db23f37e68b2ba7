"""A judged part for a person who has to decide: each finding as seen, as predicted, the difference.

`prediction.py` draws what the CAD leads one to expect, `crops.py` cuts it out beside the picture,
`place.py` shows where on the part it is, `page.py` puts all of it on a page. Nothing is judged
here.
"""

from .crops import CROPS, FindingCrops, PartCrops, Seen
from .page import write_review_page

__all__ = ["CROPS", "FindingCrops", "PartCrops", "Seen", "write_review_page"]
