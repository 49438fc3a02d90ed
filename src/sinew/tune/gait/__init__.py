"""How people turn in walking, and what a torso joint should do then."""
