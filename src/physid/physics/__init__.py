"""Differentiable rigid bodies in contact: the PhysicsLayer and what it is made of."""
