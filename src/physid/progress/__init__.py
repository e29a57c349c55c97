"""How far a command is, on a terminal and in a log."""
