"""Response curves of a joint: harmonic balance, continuation, folds, stability."""
