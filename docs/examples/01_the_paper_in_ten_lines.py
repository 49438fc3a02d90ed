"""
The paper in ten lines
======================

Four tendons pull on a silicone joint, a lever swings against its head. A campaign of the paper, made short, on the
physics twin of its joint: three pretensions, a sweep and ring-downs at each.
"""

import sinew as sn

recording = sn.simulate("short", "paper", seed=1)
found = sn.analyse(recording)
found

# %%
# More pretension moves the resonance up and brings the gain down (Figure 6). What the steady response of the same rig
# should be, solved by harmonic balance and not simulated, lies over it:

predicted = sn.predict("paper", (0, 6, 12))
axes = sn.plot.prediction(predicted, sn.plot.response(found))

# %%
# The resonance with its 90 % interval:

axes = sn.plot.resonance(found)

# %%
# A ring-down with the paper's numbers (Figure 9):

axes = sn.plot.decay(found, pretension_mm=6)
