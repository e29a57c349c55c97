"""How probable each cause is: the evidence of a diagnosis, and a model that was trained on calibration banks."""
