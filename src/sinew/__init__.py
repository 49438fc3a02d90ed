"""Sinew: a resonance laboratory for tendon-driven continuum joints, in software."""

__version__ = "0.1.0"
