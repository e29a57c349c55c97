"""What a diagnosis starts from: recordings, the nominal model, requirements on the data, phases of motion, events."""
