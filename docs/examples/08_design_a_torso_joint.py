"""
Design a torso joint
====================

A torso turns about its axis once each stride. A joint that resonates with the stride saves the drive its work, and its
pretension follows the pace. Which silicone cylinder does that for 0.25 kg m² at 0.7 to 1.1 strides in a second?

The search is kept small here; leave ``shapes``, ``materials``, ``starts`` and ``exact`` out for all of it (minutes).
"""

import sinew as sn

found = sn.design((0.7, 1.1), 7, shapes=["circle"], materials=["base"], starts=4, exact=1, proposals=1)
found

# %%
# Each proposal is a rig like any other: it can be predicted, simulated, tuned, or written to a file.

one = found.proposals[0]
predicted = sn.predict(one.rig, one.pretension_mm, amplitude_deg=5, band_hz=(0.5, 1.5))
axes = sn.plot.prediction(predicted)

# %%
# The rig as a file, for ``sinew simulate``, ``sinew run`` and everything else that takes one:

print(sn.dump_rig(one.rig)[:600], "...")
