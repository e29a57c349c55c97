"""Weighted nonlinear least squares with initial states profiled out (variable projection), by Levenberg-Marquardt."""
