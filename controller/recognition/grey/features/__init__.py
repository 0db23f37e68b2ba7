"""What a grey picture shows: edge points, lines, corners, circles and arcs."""
