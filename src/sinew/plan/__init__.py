"""This is where what we intend is written as data: rigs, limits, sweeps, ring-downs, plans."""
