"""Cross-sections, and the numbers of them that bending and torsion need."""
