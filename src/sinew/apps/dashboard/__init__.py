"""The dashboard of a bench: pages to look at, a steward that steers, and a gate before both."""
