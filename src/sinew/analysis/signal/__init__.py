"""What every record goes through: sensors, groups, repeats, harmonics, coloured noise, power."""
