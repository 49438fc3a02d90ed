"""This is where a plan runs on a rig in real time, is guarded, and recorded without losing a sample."""
