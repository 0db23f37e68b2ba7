"""The edges between faces: half-edges, curves, creases, and their checks."""
