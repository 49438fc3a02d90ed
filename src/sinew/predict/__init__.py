"""A joint's steady response, computed before anything swings: curves, bands, joints that are not built."""
