"""What bodies are: each shape is one file, which knows its contacts with the ground and with other shapes."""
