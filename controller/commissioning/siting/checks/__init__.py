"""What is checked of a site: keep-outs, reach, sights, collisions, hand-offs, seconds."""
