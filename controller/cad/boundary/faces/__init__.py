"""Faces from triangles: facets, pieces, their growth, and freeform surfaces."""
