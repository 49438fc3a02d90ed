"""Free decays: where they start, their peaks, envelope, frequency and damping."""
