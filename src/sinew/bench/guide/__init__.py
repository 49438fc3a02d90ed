"""The guide from an empty rig to its first run: who is on the bus, which way round all is, and how it moves."""
