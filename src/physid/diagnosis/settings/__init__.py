"""Every number that decides in a diagnosis: its unit, what it means, and where it was calibrated."""
