"""The contact problem of one step: how it is formulated, its laws of friction, its solution, the gradient of that."""
