"""Estimating parameters and initial states from recorded poses: what training and diagnosis share."""
