"""A joint tuned to a gait: pretension, design, tracking."""
