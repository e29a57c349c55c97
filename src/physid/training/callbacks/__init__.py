"""What a module does not do itself: histories, plots, warnings, when to stop."""
