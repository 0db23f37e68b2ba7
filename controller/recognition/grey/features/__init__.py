"""Features of a grey picture: edge points, lines, corners, circles and arcs."""
