"""Tests of a hypothesis: score tests and null distributions, lack of fit, residual wrenches, equivalence."""
