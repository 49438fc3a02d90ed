"""The physics twin: energy, dissipation, servo, sensors."""
