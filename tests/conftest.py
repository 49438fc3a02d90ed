"""How property tests draw: the same cases every time, whatever the clock says, for a busy computer is no fault of the
code. HYPOTHESIS_PROFILE=random draws others."""

import os

from hypothesis import settings

settings.register_profile("sinew", deadline=None, derandomize=True)
settings.register_profile("random", deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "sinew"))
