"""This is where the property tests are told not to watch the clock: a busy computer is no fault of the code."""

from hypothesis import settings

settings.register_profile("sinew", deadline=None)
settings.load_profile("sinew")
