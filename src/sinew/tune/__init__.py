"""This is where a joint is tuned to a gait: pretension, design, tracking."""
