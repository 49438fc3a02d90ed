"""
Results by attribute
====================

Every result is a frozen type: its quantities are attributes with units in their names, an uncertain one is an
``sn.Estimate``, and what has rows gives a DataFrame. One renderer makes text, HTML, JSON, LaTeX and pandas of any.
"""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

import sinew as sn

t = np.arange(0, 6, 0.005)
noise = np.random.default_rng(2).normal(0, 0.02, t.size)
slow = 20 * np.exp(-0.8 * t) * np.cos(2 * np.pi * 3 * t)
fast = 6 * np.exp(-1.5 * t) * np.cos(2 * np.pi * 7 * t)
swing = pd.DataFrame({"t_s": t, "angle_deg": slow + fast + noise})

found = sn.analyse(sn.read(swing, time="t_s", response="angle_deg"), modes=2)
found

# %%
# What came is a ring-down, so it has a frequency; an editor and a type checker know it from here on.

assert isinstance(found, sn.results.RingDownResult)
frequency: sn.Estimate = found.frequency_hz
print(f"{frequency} Hz; in milliseconds a period is {1000 / frequency.value:.2f}")

# %%
# Modes are rows. Each is a result itself, and together they are a table.

assert found.modes is not None
print(found.modes[1].damping_ratio)
table = found.modes.to_dataframe()
table

# %%
# A picture goes onto axes that you have, and they come back.

figure = Figure(figsize=(6, 3), layout="constrained")
axes = figure.subplots()
assert sn.plot.decay(found, axes) is axes
axes.set_title("two modes")
figure

# %%
# For a paper there is LaTeX with siunitx; for another program JSON, and the way back.

print(found.to_latex("modes"))
again = sn.results.DecayMode.from_dict(found.modes[0].to_dict())
assert again == found.modes[0]
