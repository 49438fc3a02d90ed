"""The tendon joint fitted to the recordings of a rig, and its calibration."""
