"""The joint's physics, each law once: silicone, tendons, guides, drive, the joint of them, and laws of one degree of freedom."""
