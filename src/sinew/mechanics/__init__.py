"""The joint's physics, each law once: silicone, tendons, guides, drive, head, and the motion of them together."""
