"""This is where the physics twin: energy, dissipation, servo, sensors live."""
