"""Scores under regression control: rows to score, the scores stored for them, and whether one got worse."""
