"""How far a command is: a bar on a terminal, lines in a log."""
