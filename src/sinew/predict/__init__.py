"""This is where a joint's steady response is computed before anything swings: curves, folds, stability."""
