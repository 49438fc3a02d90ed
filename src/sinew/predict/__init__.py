"""A joint's steady response, computed before anything swings: curves, folds, stability."""
