"""One degree of freedom fitted to a record in time, with its intervals."""
