"""The contact problem of one step and its reverse derivative, in scalars."""
