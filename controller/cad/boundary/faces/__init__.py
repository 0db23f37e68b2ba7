"""From triangles to faces: facets, pieces, what grows of them, and what has no formula."""
