"""A posed part's visible edges, the fit of a pose to a picture, and its evidence."""

from ._evidence import (
    Evidence,
    ImageEdges,
    asked_of_each_lamp,
    grey_evidence,
    is_predicted,
    longest_alone_mm,
    outline_evidence,
    shown_edges,
    with_inside,
)
from ._fit import (
    EdgeFit,
    FitOptions,
    Prior,
    at_rest,
    edge_jacobian,
    first_edges,
    fit_edges,
    sample_information,
    twist,
)
from ._highlight import are_highlights, are_shaded
from ._measure import Gaps, GreyMeasure, Measure, OutlineMeasure
from ._model import EdgeModel, EdgeShape, edge_model, edge_shape
from ._predict import ModelEdgePoints, predict_edges, predict_outline
from ._shade import Shading, shading_fits

__all__ = [
    "EdgeFit",
    "EdgeModel",
    "EdgeShape",
    "Evidence",
    "FitOptions",
    "Gaps",
    "GreyMeasure",
    "ImageEdges",
    "Measure",
    "ModelEdgePoints",
    "OutlineMeasure",
    "Prior",
    "Shading",
    "are_highlights",
    "are_shaded",
    "asked_of_each_lamp",
    "at_rest",
    "edge_jacobian",
    "edge_model",
    "edge_shape",
    "first_edges",
    "fit_edges",
    "grey_evidence",
    "is_predicted",
    "longest_alone_mm",
    "outline_evidence",
    "predict_edges",
    "predict_outline",
    "sample_information",
    "shading_fits",
    "shown_edges",
    "twist",
    "with_inside",
]
