"""Which view of a library a picture's features may be of: keys, index, scores, hypotheses."""
