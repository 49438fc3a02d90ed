"""What a recording says: amplitude, gain, phase, resonance, energy, decay, broadband response."""
