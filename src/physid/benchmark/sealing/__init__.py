"""Making a bank: effects are drawn, recordings made, labels sealed."""
