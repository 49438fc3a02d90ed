"""Figures and page of a fitted model."""
