"""The equations of motion of a scene as frozen data, and the formulas that they are made of."""
