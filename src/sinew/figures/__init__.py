"""Figures and pages: of recordings, predictions, fits and the paper."""
