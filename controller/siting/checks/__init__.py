"""Check a site: keep-outs, reach, visibility, collisions, hand-offs, seconds."""
