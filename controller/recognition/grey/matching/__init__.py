"""Search for the library view behind a picture's features: keys, index, scores, hypotheses."""
