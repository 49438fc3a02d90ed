"""What can be asked of equations of motion: steady motions, their curves, folds, stability, backbones."""
