"""
Your CSV
========

Any table of an oscillation will do: name the columns, and the unit where the name does not carry it. Here a swing is
made up, with noise, so that the true numbers are known: 3 Hz and a decay rate of 1.2 per second. Put the path of your
file in its place.
"""

import numpy as np
import pandas as pd

import sinew as sn

t = np.arange(0, 5, 0.005)
noise = np.random.default_rng(0).normal(0, 0.05, t.size)
angle = 20 * np.exp(-1.2 * t) * np.cos(2 * np.pi * 3 * t) + noise
table = pd.DataFrame({"t_s": t, "angle_deg": angle})  # or "swing.csv"

recording = sn.read(table, time="t_s", response="angle_deg")
found = sn.analyse(recording)
found

# %%
# Frequency and damping come by the paper's method and by a direct fit with intervals. The decay, its peaks and the
# fitted envelope:

axes = sn.plot.decay(found)

# %%
# The mechanics behind it: which stiffness and damping the data support, and how well that predicts what was held out.

fit = sn.identify(recording, "linear")
axes = sn.plot.fit(fit)
fit

# %%
# A quantity is its value, its standard deviation and its 90 % interval.

frequency = fit.natural_frequency_hz
frequency.value, frequency.std, (frequency.low, frequency.high)
