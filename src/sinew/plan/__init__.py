"""What we intend, as data: rigs, limits, sweeps, ring-downs, plans."""
