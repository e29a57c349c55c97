"""Formulas in scalars to machine code for groups of worlds, and to that of their reverse derivatives."""
