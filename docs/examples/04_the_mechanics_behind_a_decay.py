"""
The mechanics behind a decay
============================

One oscillation, several laws: is the damping viscous, dry friction, or does it grow with amplitude? ``sn.identify``
fits each and says which one the record supports, and where it cannot tell. This made-up one hardens; the true numbers
are 355.3, 1.8 and 180, and of ten such records nine should hold each of them in its interval.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.integrate import solve_ivp

import sinew as sn

omega, damping, cubic = 2 * np.pi * 3.0, 0.9, 180.0
t = np.arange(0, 6, 0.005)
motion = solve_ivp(
    lambda _, y: (y[1], -2 * damping * y[1] - omega**2 * y[0] - cubic * y[0] ** 3),
    (0, 6),
    (0.6, 0.0),
    t_eval=t,
    rtol=1e-9,
    atol=1e-9,
)
angle = motion.y[0] + np.random.default_rng(4).normal(0, 0.003, t.size)

found = sn.identify(sn.make_record(t, angle), model="auto")
print(found)

# %%
# Measured and fitted:

_, axes = plt.subplots(figsize=(7, 4))
sn.plot.fit(found, axes)
plt.show()
