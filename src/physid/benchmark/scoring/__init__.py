"""Opening the labels of a bank: verdicts judged, compared with baselines, reported."""
