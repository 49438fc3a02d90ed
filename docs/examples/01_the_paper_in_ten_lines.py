"""
The paper in ten lines
======================

Four tendons pull on a silicone joint, a lever swings against its head. More pretension moves the resonance up and
brings the gain down: the paper's main figure, predicted from the rig by harmonic balance.
"""

import matplotlib.pyplot as plt

import sinew as sn

found = sn.predict("paper", (0.0, 4.0, 8.0, 12.0))
_, axes = plt.subplots(figsize=(7, 4))
sn.plot.prediction(found, axes)
plt.show()

# %%
# What it found, as a terminal prints it:

print(found)
