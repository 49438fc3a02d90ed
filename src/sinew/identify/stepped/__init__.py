"""One degree of freedom fitted to a stepped sine by harmonic balance."""
