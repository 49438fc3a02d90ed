"""
Pretension for a gait
=====================

A robot that walks at a given stride frequency wants its torso to resonate there. Which pretension does that, how sure
is it, and what can be reached at all?
"""

import matplotlib.pyplot as plt

import sinew as sn

found = sn.tune("paper", 3.6)
print(found)

# %%
# Resonance over pretension, and the answer:

_, axes = plt.subplots(figsize=(7, 4))
sn.plot.tuning(found, axes)
plt.show()
