"""The contact problem of one step: its laws of friction, its solution, and the gradient of that."""
