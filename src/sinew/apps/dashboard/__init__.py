"""This is where the dashboard of a bench stands: pages to look at, a steward that steers, and a gate before both."""
