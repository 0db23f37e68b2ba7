"""From the objects of a picture to an answer: hypotheses proposed, fitted, weighed, decided."""
