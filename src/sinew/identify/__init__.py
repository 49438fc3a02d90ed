"""Mechanics from recordings: fits with intervals, and the comparison of models."""
