"""Simulators that make recordings and serve as references; each behind the same functions."""
