"""Where settings were calibrated, as several of them say it."""

IMPACTS = "decision 0012, calibration bank 607"
FLIGHTS = "decision 0011, calibration bank 607"
AGREEMENT = "decision 0077, bank 105713 and pushes off the centre"
