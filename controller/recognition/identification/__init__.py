"""Identification of a picture's objects: hypotheses proposed, fitted, weighed, decided."""
