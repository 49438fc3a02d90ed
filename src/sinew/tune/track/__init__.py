"""A lock that keeps a joint in resonance while its pretension changes."""
