"""
Friction of the tendons' guides
===============================

Two laws of friction with presliding, each turned to and fro by three amplitudes: Dahl's single bristle, and bristles in
parallel after Maxwell. The area of a loop is what a swing loses; small swings only bend the bristles, and hardly lose.
"""

import matplotlib.pyplot as plt
import numpy as np

import sinew as sn

_, panels = plt.subplots(1, 2, sharey=True, figsize=(8, 4))
for axes, kind in zip(panels, (sn.Dahl, sn.MaxwellSlip), strict=True):
    law = kind(level=0.0057, reach=np.radians(2.0))
    for amplitude in np.radians((1.0, 4.0, 12.0)):
        up = np.linspace(-amplitude, amplitude, 400)
        z = law.loop(up, amplitude)
        axes.plot(np.degrees(np.r_[up, -up]), np.r_[z, -z], label=f"{np.degrees(amplitude):.0f}°")
    axes.set(title=kind.__name__, xlabel="torsion of the head / °")
panels[0].set_ylabel("friction torque over its largest")
panels[0].legend(title="amplitude")
plt.show()

# %%
# The energy that a swing loses in a cycle, at a tension of 80 N of all tendons together:

for kind in (sn.Dahl, sn.MaxwellSlip):
    law = kind(level=0.0057, reach=np.radians(2.0))
    print(kind.__name__, [f"{1e3 * law.loss(80.0, np.radians(a)):.1f} mJ at {a}°" for a in (1, 4, 12)])
