"""
An oscillation from a table
===========================

A student has a file of a decaying oscillation, and wants its frequency and damping with an interval. Here the file is
made up, with noise, so that the true numbers are known: 3 Hz and a decay rate of 1.2 per second.
"""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import sinew as sn

t = np.arange(0, 4, 0.01)
noise = np.random.default_rng(1).normal(0, 0.1, t.size)
table = pd.DataFrame({"t": t, "phi": 20 * np.exp(-1.2 * t) * np.cos(2 * np.pi * 3 * t) + noise})

found = sn.analyse(sn.read(table, time="t", response="phi:deg"))
print(found)

# %%
# The decay, its peaks and the fitted envelope:

_, axes = plt.subplots(figsize=(7, 4))
sn.plot.decay(found, axes)
plt.show()
