"""Frequency and damping of free decays by maximum likelihood, and their backbone."""
