"""A rig for a joint that is not built yet, with what speaks for and against it."""
