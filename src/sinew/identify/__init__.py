"""This is where recordings become mechanics: fits with intervals, and the comparison of models."""
