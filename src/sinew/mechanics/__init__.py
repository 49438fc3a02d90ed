"""The joint's physics, each law once: silicone, tendons, guides, drive, their joint, oscillator laws."""
