"""
A joint that is not built yet
=============================

The paper's joint, shorter and longer: where does the resonance go, and how far does it swing? Each rig is designed from
the paper's and predicted at the same pretension.
"""

import matplotlib.pyplot as plt
import numpy as np

import sinew as sn

base = sn.load_rig("paper")
_, axes = plt.subplots(figsize=(7, 4))
for length_mm in (80, 95, 110):
    rig = sn.design_rig(base, sn.Design(length=length_mm / 1000))
    (curve,) = sn.predict(rig, (6.0,), amplitude_deg=20.0).prediction.branches
    assert curve.phase_90 is not None
    label = f"{length_mm} mm: lag of 90° at {curve.phase_90.frequency_hz:.2f} Hz"
    axes.plot(curve.frequency_hz, np.degrees(curve.amplitude), label=label)
axes.set(xlabel="drive frequency / Hz", ylabel="amplitude of the torsion / °")
axes.legend(title="length of the silicone")
plt.show()
