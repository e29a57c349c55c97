"""Images drawn of bodies: their shadows, the decoder, what encoders learn from, and what is shown."""
