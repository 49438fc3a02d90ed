"""This is where a joint that is not built yet becomes a rig, with what speaks for and against it."""
