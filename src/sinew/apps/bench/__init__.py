"""Commands at a bench, and what every run on one needs."""
