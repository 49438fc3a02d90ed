"""Figures and pages of the paper and the report."""
