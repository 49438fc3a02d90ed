"""Stepped sines: amplitude response, resonance, saturation, energy."""
