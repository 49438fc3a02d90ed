"""
Measure on the physics twin
===========================

A plan runs on the twin as on a bench: sensors with noise, a drive that gives way, segments with pauses. The analysis
reads the recording as it would read one of a real bench.
"""

import matplotlib.pyplot as plt
import numpy as np

import sinew as sn

plan = sn.Plan(
    name="one pretension",
    sample_hz=200.0,
    pretension=sn.Pretension(pretension_mm=(6.0,)),
    sweep=sn.Sweep(frequency_hz=tuple(np.arange(2.6, 4.81, 0.2)), settle_s=3.0, periods=5, repeats=3),
)
recording = sn.simulate(plan, "paper", seed=3)
found = sn.analyse(recording)

_, (above, below) = plt.subplots(2, 1, sharex=True, figsize=(7, 6))
sn.plot.response(found, above)
sn.plot.phase(found, below)
plt.show()

# %%
# The resonance with its interval:

print(found)
