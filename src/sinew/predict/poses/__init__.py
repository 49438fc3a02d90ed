"""Poses of a joint that bends: how it rests, what holds it there, and how far it may go."""
