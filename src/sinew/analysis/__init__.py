"""This is where what a recording says: amplitude, gain, phase, resonance, ring-down live."""
