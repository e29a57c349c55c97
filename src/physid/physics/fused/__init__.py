"""The same physics compiled for CPU: equal to the torch reference up to rounding, and much faster."""
