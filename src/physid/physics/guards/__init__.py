"""What protects a rollout: from what comes in, and from what may not be asked of it."""
