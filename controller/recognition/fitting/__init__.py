"""A posed part's visible edges, the fit of a pose to a picture, and what speaks for it."""

from ._evidence import Evidence, ImageEdges, grey_evidence, outline_evidence, with_inside
from ._fit import EdgeFit, FitOptions, edge_jacobian, fit_edges
from ._measure import Gaps, GreyMeasure, LoopMeasure, Measure
from ._model import EdgeModel, EdgeShape, edge_model, edge_shape
from ._predict import EdgePoints, predict_edges, predict_outline
from ._shade import Shading, shading_fit

__all__ = [
    "EdgeFit",
    "EdgeModel",
    "EdgePoints",
    "EdgeShape",
    "Evidence",
    "FitOptions",
    "Gaps",
    "GreyMeasure",
    "ImageEdges",
    "LoopMeasure",
    "Measure",
    "Shading",
    "edge_jacobian",
    "edge_model",
    "edge_shape",
    "fit_edges",
    "grey_evidence",
    "outline_evidence",
    "predict_edges",
    "predict_outline",
    "shading_fit",
    "with_inside",
]
