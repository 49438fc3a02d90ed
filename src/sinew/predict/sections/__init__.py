"""This is where a cross-section becomes the numbers that bending and torsion need."""
