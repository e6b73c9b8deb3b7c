"""Scores side by side: the comparison table and the published figures."""
