"""What is checked of a site: keep-outs, reach, visibility, collisions, hand-offs, seconds."""
