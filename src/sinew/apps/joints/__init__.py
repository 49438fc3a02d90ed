"""Commands about joints and their rigs: calibrated, predicted, tuned, designed."""
