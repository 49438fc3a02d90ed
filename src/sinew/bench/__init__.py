"""A plan on a rig in real time: run, guarded, and recorded without losing a sample."""
