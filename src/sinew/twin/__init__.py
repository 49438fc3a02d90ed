"""The physics twin: a rig as numbers, a plan run on them, sensors."""
