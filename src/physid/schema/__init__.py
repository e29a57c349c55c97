"""What a configuration may hold: keys and types, as the classes that it names have them."""
