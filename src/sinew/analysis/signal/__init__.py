"""What every record goes through: sensors, their limits, groups, repeats, harmonics, coloured noise, power."""
