"""Computations behind the pages of the dashboard: plain functions, JSON in and out."""
