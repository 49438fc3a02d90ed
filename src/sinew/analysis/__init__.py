"""What a recording says: amplitude, gain, phase, resonance, ring-down."""
