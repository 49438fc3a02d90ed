"""Fits of mechanics to recordings, with intervals, and the comparison of models."""
